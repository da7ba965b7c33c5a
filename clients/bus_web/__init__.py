"""The bus in a browser: one small server for the page, for Foxglove, and for turtlesim.

    browser --> `connections.py` --> `gate.py` --> `server.py` --+-- files of `page/` (`files.py`)
                                                                 +-- `page_session.py` (one open page)
                                                                 +-- `foxglove/` (one client of Foxglove)
    bus --> `hub.py`, `shared_subscriptions.py` --> `model.py` (rows, rates) --> sessions
    sessions --> `page_playback.py`, `foxglove/playing.py` --> `playback.py` --> the player (`bus_bag.page`)
    session --> `outbox.py` --> `sender.py` --> WebSocket

`bus top` uses `model.py` and `rows.py`, too. `program.py` is `bus web`.

Invariants:

- The server listens on loopback or a UNIX socket only (`place.py`). Each request must pass `gate.py`, which
  looks at the token, Host and Origin.
- Everything that a client can make the server hold is bounded: connections, frames, messages that wait. A
  slow client only loses its own messages, and delays no other.
- There is one node and one look at the bus a second for all clients, and none without a client.
- Texts and messages of other programs are data. The page never inserts them as HTML.

Read first: `hub.py`, `server.py`, `page_protocol.py`.

Tests: `tests/unit/bus_web/`, on `tests/world/web_world.py`; `tests/system/test_web.py`,
`tests/system/test_web_page.py`, `tests/system/test_web_bag.py`.
"""
