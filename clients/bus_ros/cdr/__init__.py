"""CDR, ROS 2's encoding of sent and stored messages: to and from MessagePack payloads, for any type.

A bag, a bridge or a viewer needs only the schema of a type, which discovery delivers. It needs neither a
class nor a definition file.

    schema --> `shapes.py` --+-- `encoder.py`, `decoder.py`   source, compiled for each type (`source.py`)
                             +-- `definition.py`              the text of the type, as bags hold it
    `codec.py` (Codec: one for each type) puts these together;  `layout.py` has the alignment

Invariants:

- The encoder writes little-endian XCDR1, as ROS 2 does. The decoder reads both byte orders, XCDR1 and XCDR2.
- Input is hostile: a count is compared with the number of remaining bytes before any element is made.
- No name of a type or field gets into generated source, because other processes choose these names.

Read first: `codec.py`, then `shapes.py`. Tests: `tests/unit/bus_ros/cdr/`, `tests/property/test_cdr.py`,
`tests/golden/`.
"""

from bus_ros.cdr.codec import CdrError, Codec, codec_of, schema_of_definition

__all__ = ["CdrError", "Codec", "codec_of", "schema_of_definition"]
