"""The command-line tool `bus`: one module a verb, imported when it is chosen.

    `entry.py` --+-- `run.py`   (`bus run`, a short way of its own)
                 +-- `main.py`  (COMMANDS, parsers, exit codes) --> topic/hz.py, ...: add_arguments, main

    verbs that ask one thing   `query.py`: a small blocking client without an event loop
    verbs that stay            `stream.py`: a hidden node on an event loop, ended by signals

Shared parts: `output.py` (texts, JSON, tables), `render.py` (messages as text), `populate.py` (messages from
YAML), `filter.py`, `fields.py`, `stats.py`, `qosargs.py`, `completion.py`, `suggestions.py`.

Invariants:

- Only the module of the chosen verb is imported. Slow modules are imported inside functions.
- Output and options are those of `ros2` where it has the verb.
- Everything printed goes through `output.py`, because texts of other processes may have escape sequences.
- `main(args)` returns the exit code. An error is a CommandError or BusError with one line for the user.
- `--filter` evaluates a safe subset of Python, at a bounded cost.

docs/architecture.md, "How to add", says how to add a verb; docs/cli.md describes each.

Read first: `main.py`, then `query.py` and `stream.py`.

Tests: `tests/unit/bus_cli/`, `tests/system/test_cli_tool.py`, and a file of tests/system/ for each command.
"""
