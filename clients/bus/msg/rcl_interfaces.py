"""rcl_interfaces of ROS 2 Jazzy, as far as the bus itself needs them: the log.

Made by `make messages`.
"""

from typing import ClassVar

from msgspec import field

from bus.msg._types import Message, string, uint8, uint32
from bus.msg.builtin_interfaces import Time

__all__ = [
    "Log",
]


class Log(Message, kw_only=True):
    """One line of a node's log, as published on /rosout."""

    DEBUG: ClassVar[int] = 10
    INFO: ClassVar[int] = 20
    WARN: ClassVar[int] = 30
    ERROR: ClassVar[int] = 40
    FATAL: ClassVar[int] = 50

    stamp: Time = field(default_factory=Time)
    level: uint8 = 0
    name: string = ""
    msg: string = ""
    file: string = ""
    function: string = ""
    line: uint32 = 0
