"""The native core of recording, in C: MCAP records out of packed messages, and the CRC of chunks.

Owns: `program_of`, the program of a message type, and `crc32`. Must not know: topics, files, the recorder.

`program.h` converts a payload to CDR by a program, `records.h` makes records of a whole pack, and `crc.h`
has the CRC. All three are without Python. `py_records.c` is their binding (`_core.pyi` has the types).
`program.py` makes programs.

Invariants:

- A program gives the bytes of `bus_ros.cdr`, or refuses the pack. The caller then uses `bus_ros.cdr`. So
  payloads that are no message of the type have the same errors and counters with and without the core.
- A program is checked before its first run. Payloads are hostile: a run reads and writes within its buffers
  only, and its time grows with the payload.
- Without the core there are no programs, and `crc32` is zlib's.

Read first: `program.h`. Tests: `tests/unit/bus_bag/core/`, `tests/property/test_bag_programs.py`,
`tests/native/fuzz_records.c`.
"""

from bus_bag.core.program import Program, crc32, program_of

__all__ = ["Program", "crc32", "program_of"]
