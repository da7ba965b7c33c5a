"""std_srvs of ROS 2 Jazzy.

Made by `make messages`.
"""

from bus.msg._types import Message, string
from bus.srv import Service

__all__ = [
    "Empty",
    "SetBool",
    "Trigger",
]


class Empty(Service):
    """A call without content."""

    class Request(Message, kw_only=True):
        pass

    class Response(Message, kw_only=True):
        pass


class SetBool(Service):
    """Switch something on or off."""

    class Request(Message, kw_only=True):
        data: bool = False

    class Response(Message, kw_only=True):
        success: bool = False
        message: string = ""


class Trigger(Service):
    """Make something happen."""

    class Request(Message, kw_only=True):
        pass

    class Response(Message, kw_only=True):
        success: bool = False
        message: string = ""
