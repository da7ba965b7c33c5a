"""Foxglove's protocol, by which Foxglove, Lichtblick and PlotJuggler look at the bus.

    WebSocket --> `protocol.py` (frames) --> `session.py` --+-- `channels.py`    topics as channels
                                                            +-- `publishing.py`  a client publishes
                                                            +-- `calls.py`       services
                                                            +-- `parameters.py`  parameters of nodes
                                                            +-- `playing.py`     a bag
                                                            +-- `assets.py`      files of packages
                                                            +-- `connections.py` endpoints of topics

`formats.py` describes types and translates messages to CDR, once for all clients.

Invariants:

- `protocol.py`, `advertised.py`, `connections.py`, `subscriptions.py` and `values.py` are pure.
- A frame that makes no sense is answered with a status; it never ends the server.
- An id that was given to a channel or service is not given again to another one.
- What a client may do besides looking is in `Permissions` (`session.py`).
- No file outside of a share folder is sent (`assets.py`).
- Calls and questions under way are bounded in number (`tasks.py`).

Read first: `protocol.py`, then `session.py`.

Tests: `tests/unit/bus_web/foxglove/`, `tests/system/test_web_foxglove.py`.
"""
