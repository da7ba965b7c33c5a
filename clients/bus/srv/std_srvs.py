"""std_srvs of ROS 2 Jazzy."""

from bus.msg._types import Message, string
from bus.srv import Service

__all__ = [
    "Empty",
    "SetBool",
    "Trigger",
]


class Empty(Service):
    """Have something done; nothing is said about it."""

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
    """Have something done."""

    class Request(Message, kw_only=True):
        pass

    class Response(Message, kw_only=True):
        success: bool = False
        message: string = ""
