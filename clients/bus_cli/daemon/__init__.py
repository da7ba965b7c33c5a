"""Verbs of `bus daemon`.

start, stop, restart, reload, status and peers ask a running busd, or start one. install and uninstall write
and remove systemd units. `units.py` has the texts of the units.

Invariants: uninstall only removes files that install has written; each wait has a time limit; only start
imports asyncio.

Read first: `units.py`, then `restart.py`. Tests: `tests/system/test_cli_units.py`,
`tests/system/test_daemon.py`, `tests/system/test_handover.py`.
"""
