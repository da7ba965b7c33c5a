"""Verbs of `bus bench`, and the processes that they start for a measurement.

    `options.py` (command line) --> `plan.py` --> `measure.py` --> `session.py` --> `harness.py` --> processes
                                                       |              words: `task.py` <--> `worker.py`
                                                  `figures.py` (percentiles, tables)

Invariants:

- A child ends when its stdin ends. So no process is left behind, whatever ends the verb.
- The words between verb and worker are lines of JSON with the fields of `task.py`.
- `figures.py`, `plan.py` and `options.py` know no processes.
- A failed measurement is a Failure with a text, never a number.

Read first: `plan.py`, `task.py`. Tests: `tests/unit/bus_cli/bench/`, `tests/system/test_cli_bench.py`.
"""
