"""CDR, in which ROS 2 sends and stores messages: to MessagePack payloads and from them, for any type.

What a bag, a bridge or a viewer needs of a type is its schema, as it travels with discovery; no class and no
definition file.
"""

from bus_ros.cdr.codec import CdrError, Codec, codec_of, schema_of_definition

__all__ = ["CdrError", "Codec", "codec_of", "schema_of_definition"]
