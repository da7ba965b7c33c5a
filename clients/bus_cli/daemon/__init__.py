"""Verbs of `bus daemon`.

start, stop, restart, reload, status and peers ask a running busd, or start one. install and uninstall write
and remove systemd units, whose text is in `units.py`.

Invariants: uninstall removes only files that install wrote; a verb that waits has a bound; asyncio is
imported by start only.

Read first: `units.py`, then `restart.py`. Tests: `tests/system/test_cli_units.py`,
`tests/system/test_daemon.py`, `tests/system/test_handover.py`.
"""
