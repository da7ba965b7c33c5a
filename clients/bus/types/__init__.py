"""Message types: from a class to bytes and back, and the description of a type for other programs.

    class --> `support.py` (TypeSupport: one for each class) --+-- `check.py`    are the fields right?
                                                               +-- `schema.py`   describe; build a class
                                                               +-- `hash.py`     ROS 2's hash, or ours
    name --> `classes.py` --> `definitions.py` (files) --> `idl.py` (their language)

`service.py` has the envelopes of requests and replies. `large_fields.py` encodes and decodes around a long
field without copying it. `diff.py` describes the difference between two descriptions. `unsent.py` bounds the
size of a decoded message.

Invariants:

- No module trusts schemas and messages from other processes: `build` and decoding bound everything first.
- Only classes of this program are compiled to code, never schemas from other processes.
- A type that ROS 2 has, too, gets the same hash here (RIHS01). Two types match only if the hashes are equal.
- A check that returns True is sure. False means that a slower, exact path decides.
- No module here knows topics or the wire.

Read first: `support.py`, then `schema.py`.

Tests: `tests/unit/bus/types/`; the native encoder against the Python one: `tests/property/test_plans.py`,
`tests/property/test_plans_decode.py`.
"""
