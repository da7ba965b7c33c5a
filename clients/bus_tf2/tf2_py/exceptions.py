"""The exceptions of a look-up without a transform."""

from bus.base.printable import printable

__all__ = [
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "TimeoutException",
    "TransformException",
]


class TransformException(Exception):
    """The base of all of tf2's.

    Its text may contain names from other processes. str(), which tracebacks and logs show, has no control
    characters except newlines and tabs.
    """

    def __str__(self) -> str:
        return printable(super().__str__())


class ConnectivityException(TransformException):
    """The two frames are in trees that nothing connects."""


class LookupException(TransformException):
    """There is no frame of that name, or the tree has a loop."""


class ExtrapolationException(TransformException):
    """The time is outside of the kept times."""


class InvalidArgumentException(TransformException):
    """A frame's name is empty, or begins with a slash."""


class TimeoutException(TransformException):
    """Nothing came in time; raised by clients of a buffer server."""


for _error in (
    TransformException,
    ConnectivityException,
    LookupException,
    ExtrapolationException,
    InvalidArgumentException,
    TimeoutException,
):
    _error.__module__ = "tf2"  # as a traceback shows them in ROS 2
