"""Message types: from a class to bytes and back, and what the bus tells others about a type.

    class --> `support.py` (TypeSupport: one for each class) --+-- `check.py`    are the fields right?
                                                               +-- `schema.py`   describe; build a class
                                                               +-- `hash.py`     ROS 2's hash, or ours
    name --> `classes.py` --> `definitions.py` (files) --> `idl.py` (their language)

`service.py` has the envelopes of requests and replies. `large_fields.py` encodes and decodes around a long
field without copying it. `diff.py` says where two descriptions differ. `unsent.py` bounds the size of a
decoded message.

Invariants:

- A schema or a message of another process is not trusted: `build` and decoding bound everything first.
- Code is compiled only from classes of this program, never from a schema of another process.
- A type that ROS 2 has, too, gets the same hash here (RIHS01). Two types match only if the hashes are equal.
- A check that returns True is sure. False means that a slower, exact path decides.
- No module here knows topics or the wire.

Read first: `support.py`, then `schema.py`.

Tests: `tests/unit/bus/types/`; the native encoder against the Python one: `tests/property/test_plans.py`,
`tests/property/test_plans_decode.py`.
"""
