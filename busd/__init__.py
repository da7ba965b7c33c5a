"""The daemon of the bus: routes messages between the processes of one machine. See `bus` for the library.

    `entry.py` -> `run.py` (options, signals) -> `server/` (sockets) -> `core/` (all decisions)
                                                 `config/` (busd.toml), `process/` (log, restart)

Invariants:

- `core/` decides and does no I/O; `server/` does I/O and decides nothing about routing.
- One thread, one event loop. Other threads only write the log and close strange descriptors.
- Nothing that a peer sends, or does not read, stops busd or delays others by more than a turn.
- busd imports the lower layers of `bus` only, never nodes or endpoints. import-linter checks this.

Read first: `core/broker.py`, then `server/serving.py`; docs/architecture.md, "The broker".

Tests: `tests/unit/busd/`, `tests/system/test_daemon.py`, `tests/system/test_limits.py`,
`tests/system/test_turns.py`.
"""
