"""Checks for message and service classes, and messages as bytes."""

from rclpy.serialization import deserialize_message, serialize_message
from rclpy.type_support import check_for_type_support, check_is_valid_msg_type, check_is_valid_srv_type
from show import attempt
from test_msgs.action import Fibonacci
from test_msgs.msg import Arrays, BasicTypes, Strings
from test_msgs.srv import Empty


class Imports(type):
    _TYPE_SUPPORT = None

    @classmethod
    def __import_type_support__(cls):
        pass


class Mock(metaclass=Imports):
    pass


for name, what in (
    ("message", BasicTypes),
    ("service", Empty),
    ("action", Fibonacci),
    ("request", Empty.Request),
    ("mock", Mock),
    ("object", object()),
    ("None", None),
):
    for check in (check_for_type_support, check_is_valid_msg_type, check_is_valid_srv_type):
        attempt(f"{check.__name__} of {name}", check, what)
messages = (
    BasicTypes(bool_value=True, int8_value=-5, uint64_value=2**63, float64_value=1.5),
    Strings(string_value="Grüße", bounded_string_value="kurz"),
    Arrays(int32_values=[1, -2, 3], string_values=["a", "", "c"]),
)
for message in messages:
    data = serialize_message(message)
    print(type(data).__name__, deserialize_message(data, type(message)) == message)
attempt("no message", serialize_message, "text")
attempt("no type", deserialize_message, b"", str)
