"""The engine for zenoh, between buses on different machines; with the extra `zenoh`.

    `engine.py` --+-- `presence.py`  which buses, nodes and endpoints there are, from tokens (`keys.py`)
                  +-- `writing.py`   a way out: `window.py` keeps parts, `probing.py` asks for acks
                  +-- `reading.py`   a way in: `arrival.py` orders parts, `missing.py` asks again, `acks.py`
                  +-- `links.py`     addresses that are up or not; `own_log.py`: refused connections
    `session.py` -- the package zenoh, its threads;  `records.py` -- messages as parts

Invariants:

- Only `session.py` and `own_log.py` import the package zenoh. import-linter checks this.
- zenoh calls back in its own threads. `session.py` hands everything to the event loop, bounded.
- zenoh may drop any part. A way out keeps each part, within a bound, until every importer's bridge has it.
- Tokens and keys of others are hostile: a token that can't be read is `Broken`, and only its sender suffers.
- The form of keys and records is a protocol between releases: its version is in each key.

Read first: the docstring of `keys.py`, then `window.py` and `arrival.py`.

Tests: `tests/unit/bus_bridge/zenoh/`, `tests/system/test_bridge_zenoh_engine.py`,
`tests/system/test_bridge_zenoh.py`, `tests/system/test_bridge_zenoh_links.py`.
"""
