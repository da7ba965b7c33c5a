"""Verbs of `bus param`.

`remote.py` finds a node and calls its six parameter services; every verb uses it. `dump.py` writes files that
`load.py` and `--params-file` read.

Invariants: verbs print the same lines as `ros2 param`; `remote.py` does not know the output of the verbs;
values are read by the rules of `bus.parameters.file`.

Read first: `remote.py`. Tests: `tests/system/test_cli_param.py`.
"""
