"""The serials of a peer's ACKNACKs, NACK_FRAGs or HEARTBEATs: new, old, or of a restarted peer. Pure.

The standard calls them counts.
"""

from enum import Enum
from typing import Final

__all__ = ["Serial", "Serials"]

_HALF: Final = 1 << 31
_QUIET_NS: Final = 500_000_000


class Serial(Enum):
    """What a serial says of its message."""

    NEW = "new"
    OLD = "old"
    """A newer one has come before: it was repeated, or was late."""
    RESTARTED = "restarted"
    """The peer counts from 1 again, with the GUID that it had before."""


class Serials:
    """The serials of one peer. They rise, and wrap around at 2**32.

    Two rising ones below the last one mean a restart, if no new one has come for a while: a network may
    repeat or delay messages.
    """

    def __init__(self) -> None:
        self._last = -1
        self._last_ns = 0
        self._older = -1

    def judge(self, serial: int, now_ns: int) -> Serial:
        """Note the serial of a message that has come."""
        if serial == self._last:
            return Serial.OLD
        is_new = _is_newer(serial, self._last)
        rises = self._older >= 0 and _is_newer(serial, self._older)
        if not is_new and not (rises and now_ns - self._last_ns >= _QUIET_NS):
            self._older = serial
            return Serial.OLD
        self._last, self._last_ns, self._older = serial, now_ns, -1
        return Serial.NEW if is_new else Serial.RESTARTED


def _is_newer(serial: int, last: int) -> bool:
    return last < 0 or 0 < (serial - last) % (2 * _HALF) < _HALF
