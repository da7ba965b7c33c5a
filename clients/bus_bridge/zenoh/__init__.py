"""The engine for zenoh, between buses on different machines; with the extra `zenoh`.

    `engine.py` --+-- `presence.py`  present buses, nodes and endpoints, from tokens (`keys.py`, `groups.py`)
                  +-- `writing.py`   a route out: `window.py` keeps parts, `probing.py` asks for acks
                  +-- `reading.py`   a route in: `arrival.py` orders parts, `missing.py` asks again, `acks.py`
                  +-- `links.py`     the state of addresses; `own_log.py`: refused connections
    `session.py` -- the package zenoh, its threads;  `records.py` -- messages as parts

Invariants:

- Only `session.py` and `own_log.py` import the package zenoh. import-linter checks this.
- zenoh calls back in its own threads. `session.py` passes everything to the event loop through bounded
  queues.
- zenoh may drop any part. A route out keeps each part, within a limit, until every importer's bridge has it.
- Tokens and keys of other bridges are hostile, and do not prove their author. An unreadable token is
  `Broken`, and has no effect.
- The form of keys and records is a protocol between releases: its version is in each key.

Read first: the docstring of `keys.py`, then `window.py` and `arrival.py`.

Tests: `tests/unit/bus_bridge/zenoh/`, `tests/system/test_bridge_zenoh_engine.py`,
`tests/system/test_bridge_zenoh.py`, `tests/system/test_bridge_zenoh_links.py`,
`tests/system/test_bridge_router.py`.
"""
