"""CDR, in which ROS 2 sends and stores messages: to MessagePack payloads and from them, for any type.

What a bag, a bridge or a viewer needs of a type is its schema, as it travels with discovery; no class and no
definition file.

    schema --> `shapes.py` --+-- `encoder.py`, `decoder.py`   source, compiled for each type (`source.py`)
                             +-- `definition.py`              the text of the type, as bags hold it
    `codec.py` (Codec: one for each type) puts these together;  `layout.py` has the alignment

Invariants:

- The encoder writes little-endian XCDR1, as ROS 2 does. The decoder reads both byte orders, XCDR1 and XCDR2.
- Input is hostile: a count is compared with the bytes that are left before anything is made of it.
- No name of a type or field gets into generated source, because other processes choose these names.

Read first: `codec.py`, then `shapes.py`. Tests: `tests/unit/bus_ros/cdr/`, `tests/property/test_cdr.py`,
`tests/golden/`.
"""

from bus_ros.cdr.codec import CdrError, Codec, codec_of, schema_of_definition

__all__ = ["CdrError", "Codec", "codec_of", "schema_of_definition"]
