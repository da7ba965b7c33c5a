"""example_interfaces of ROS 2 Jazzy: its services.

Made by `make messages`.
"""

from bus.msg._types import Message, int64, string
from bus.srv import Service

__all__ = [
    "AddTwoInts",
    "SetBool",
    "Trigger",
]


class AddTwoInts(Service):
    """Add two numbers."""

    class Request(Message, kw_only=True):
        a: int64 = 0
        b: int64 = 0

    class Response(Message, kw_only=True):
        sum: int64 = 0


class SetBool(Service):
    """Switch something on or off; an example, use a type that says what it means."""

    class Request(Message, kw_only=True):
        data: bool = False

    class Response(Message, kw_only=True):
        success: bool = False
        message: string = ""


class Trigger(Service):
    """Make something happen; an example, use a type that says what it means."""

    class Request(Message, kw_only=True):
        pass

    class Response(Message, kw_only=True):
        success: bool = False
        message: string = ""
