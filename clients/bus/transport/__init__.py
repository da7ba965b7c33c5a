"""One UNIX stream socket on the event loop, for both ends: bytes and descriptors in and out.

    socket -> `stream.py` -> Session (bus.wire) -> owner: the library's connection, or a peer of busd
    socket <- `stream.py` <- Outbox  (bus.wire) <- owner

`stream_state.py` has the states of the reading half and the writing half, one table each. `hangups.py` finds
the end of the other side if uvloop does not report it. `memory.py` makes glibc keep freed memory.

Invariants:

- A stream does not know the meaning of messages.
- Each half changes its state only by its table. `stream.py` acts on the states (watches the socket, shuts a
  half).
- A published sample leaves at once if the socket accepts it, not at the end of the loop's turn.
- Descriptors of a frame go with its first byte, in a separate `sendmsg`.
- Behaviour is the same on asyncio's loop and on uvloop.

Read first: `stream_state.py`, then `stream.py`.

Tests: `tests/unit/bus/transport/`; the allowed system calls of a message: `tests/system/test_calls.py`.
"""
