"""The verbs of `bus tf2`: the programs of tf2 under short names.

`echo.py`, `monitor.py` and `frames.py` run programs of `bus_tf2.programs`; `ends.py` has the exit status
after a signal, and `heard.py` completes names of frames.

Read first: `echo.py`. Tests: `tests/system/test_tf2_programs.py`.
"""
