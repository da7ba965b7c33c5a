"""The protocol of the bus, for both ends: bytes in, messages and runs out, and back. See docs/protocol.md.

    bytes -> `framing.py` (frames) -> `codec.py` (control messages) --+-> `session.py` (rules)
                                   -> `runs.py` (samples)  -----------+
    `outbox.py` (the order of sending) -> bytes

`layout.py` has the place of each byte, `messages.py` and `routes.py` the control messages, `records.py` their
parts, `bounds.py` the allowed ranges, `greeting.py` a Hello read alone. `runs.py` also has `RunQueue`, the
one bounded queue of the bus, and `Account`, which counts bytes.

Invariants:

- No I/O: no asyncio, socket, os, threads or clock. import-linter checks this.
- Every input may be hostile. A forged length allocates nothing, and the first frame that breaks the layout
  ends the session.
- Payloads are never decoded here, and a large one is not copied twice.
- Old and new versions understand each other: a new field of a message has a default, a receiver ignores
  unknown fields, and a tag keeps its meaning.
- `push` and `pop` of a `RunQueue` are O(1), whatever the number of samples in a run.

Read first: `layout.py`, then `session.py`.

Tests: `tests/unit/bus/wire/`, `tests/property/test_wire_properties.py`,
`tests/property/test_session_fuzz.py`; recorded bytes of earlier versions: `tests/golden/`; the page:
`tests/unit/test_docs.py`.
"""
