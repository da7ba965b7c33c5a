"""The configuration: the content of busd.toml, and its reload while busd runs.

    busd.toml --> `file.py` (Config, frozen) --> limits and topic rules: `busd.core.limits`
                                             --> users and groups: `access.py` --> rules: `busd.core.access`
    SIGHUP, `bus daemon reload` --> `reload.py` --> Broker.reconfigure

Invariants:

- A configuration is applied as a whole or not at all. If the new file is wrong, the old one stays in force,
  and the log names the wrong place.
- An unknown key is an error.
- These modules read and check; what a value does is decided in `busd.core`.
- docs/configuration.md describes each key.

Read first: `file.py`. Tests: `tests/unit/busd/config/`, `tests/system/test_reload.py`,
`tests/system/test_access.py`.
"""
