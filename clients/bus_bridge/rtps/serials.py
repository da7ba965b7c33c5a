"""The serials of a peer's ACKNACKs, NACK_FRAGs or HEARTBEATs: which of them is to be heeded. Pure."""

from enum import Enum
from typing import Final

__all__ = ["Serial", "Serials"]

_HALF: Final = 1 << 31


class Serial(Enum):
    """What a serial says of its message."""

    NEW = "new"
    OLD = "old"
    """A newer one has come before: it was repeated, or was late."""
    ANEW = "anew"
    """The peer counts anew: it has started again, with the GUID that it had before."""


class Serials:
    """Serials rise, and may wrap around. Two old ones that rise are no accident: the peer counts anew."""

    def __init__(self) -> None:
        self._last = -1
        self._older = -1

    def judge(self, serial: int) -> Serial:
        """Note the serial of a message that has come."""
        if _is_newer(serial, self._last):
            self._last, self._older = serial, -1
            return Serial.NEW
        if serial == self._last:
            return Serial.OLD
        if self._older >= 0 and _is_newer(serial, self._older):
            self._last, self._older = serial, -1
            return Serial.ANEW
        self._older = serial
        return Serial.OLD


def _is_newer(serial: int, last: int) -> bool:
    return last < 0 or 0 < (serial - last) % (2 * _HALF) < _HALF
