"""Values of message fields: sequences of numbers, texts and messages that are converted, and refusals."""

from array import array

import numpy
from rclpy.serialization import deserialize_message, serialize_message
from test_msgs.msg import Arrays, BasicTypes, Strings, UnboundedSequences


def arrived(label, cls, field, value):
    """Print the value of the field after a message's way through its serialized form."""
    try:
        message = cls()
        setattr(message, field, value)
        got = getattr(deserialize_message(serialize_message(message), cls), field)
    except Exception:
        print(f"{label}: refused")
    else:
        print(f"{label}: {type(got).__name__} {got.tolist() if hasattr(got, 'tolist') else got}")


for field in ("float32_values", "float64_values", "int8_values", "uint16_values", "int64_values"):
    print(field)
    arrived("  integers", UnboundedSequences, field, [0] * 3)
    arrived("  tuple", UnboundedSequences, field, (1, 2))
    arrived("  range", UnboundedSequences, field, range(3))
    arrived("  generator", UnboundedSequences, field, (number for number in range(3)))
    arrived("  values", UnboundedSequences, field, {"a": 1}.values())
    arrived("  floats", UnboundedSequences, field, array("f", [0.5]))
    arrived("  doubles", UnboundedSequences, field, array("d", [0.5]))
    arrived("  octets", UnboundedSequences, field, array("B", [1]))
    arrived("  numpy", UnboundedSequences, field, numpy.arange(3, dtype=numpy.int16))
    arrived("  numpy floats", UnboundedSequences, field, numpy.array([0.5], dtype=numpy.float32))
    arrived("  booleans", UnboundedSequences, field, [True, False])
arrived("array of integers", Arrays, "float64_values", [1, 2, 3])
arrived("array of a range", Arrays, "int32_values", range(3))
arrived("array of numpy", Arrays, "float64_values", numpy.ones(3, dtype=numpy.float32))
arrived("tuple of texts", UnboundedSequences, "string_values", ("a", "b"))
message = UnboundedSequences()
message.basic_types_values = tuple(BasicTypes(int32_value=number) for number in range(3))
again = deserialize_message(serialize_message(message), UnboundedSequences)
print([one.int32_value for one in again.basic_types_values])
arrived("text for a number", BasicTypes, "int32_value", "1.0")
arrived("number for a text", Strings, "string_value", 5)
arrived("text for integers", UnboundedSequences, "int32_values", "12")
arrived("a number for several", UnboundedSequences, "int32_values", 5)
arrived("too large", UnboundedSequences, "int8_values", [300])
arrived("no messages", UnboundedSequences, "basic_types_values", [5])
