"""The command-line tool `bus`: one module for each verb, imported only for that verb.

    `entry.py` --+-- `run.py`   (`bus run`, a short separate way)
                 +-- `main.py`  (COMMANDS, parsers, exit codes) --> topic/hz.py, ...: add_arguments, main

    verbs with one question   `query.py`: a small blocking client without an event loop
    verbs that keep running   `stream.py`: a hidden node on an event loop, ended by signals

Shared parts: `output.py` (texts, JSON, tables), `render.py` (messages as text), `populate.py` (messages from
YAML), `filter.py`, `fields.py`, `stats.py`, `qosargs.py`, `completion.py`, `suggestions.py`.

Invariants:

- Only the module of the chosen verb is imported. Slow modules are imported inside functions.
- If `ros2` has the verb, output and options are the same.
- All output goes through `output.py`, because texts of other processes may contain escape sequences.
- `main(args)` returns the exit code. An error is a CommandError or BusError with one line for the user.
- `--filter` evaluates a safe subset of Python, at a bounded cost.

docs/architecture.md, "How to add", explains how to add a verb. docs/cli.md describes each verb.

Read first: `main.py`, then `query.py` and `stream.py`.

Tests: `tests/unit/bus_cli/`, `tests/system/test_cli_tool.py`, and a file of tests/system/ for each command.
"""
