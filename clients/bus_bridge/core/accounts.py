"""Counters of all messages of one route: taken = sent + waiting + dropped, by reason. Pure."""

from typing import Final

from bus.vocabulary import DropReason

__all__ = ["Account"]

_MOST_LOST: Final = 2**53 - 1
"""The highest number that every reader of a report can represent."""


class Account:
    """The counters of one route."""

    __slots__ = ("_known_losses", "bytes", "dropped", "lost", "sent", "taken")

    def __init__(self) -> None:
        self.taken = 0
        self.sent = 0
        self.bytes = 0
        """Bytes of payload in sent messages."""
        self.dropped: dict[str, int] = {}
        """Taken messages that were dropped, by reason."""
        self.lost = 0
        """Messages lost before they reached the bridge."""
        self._known_losses = 0

    def drop(self, reason: DropReason, count: int = 1) -> None:
        if count:
            self.dropped[reason] = self.dropped.get(reason, 0) + count

    def miss(self, numbers: int, in_engine: int) -> None:
        """Count missing numbers. `in_engine`: all messages that the engine has received and lost so far.

        The engine counts those by their reason. Their numbers are missing, too, and count only once.
        """
        # A far side may claim any number. busd closes a connection that reports more than 62 bits.
        self.lost = min(self.lost + max(0, numbers - (in_engine - self._known_losses)), _MOST_LOST)
        self._known_losses = in_engine

    @property
    def waiting(self) -> int:
        """Number of messages that were neither sent nor dropped."""
        return self.taken - self.sent - sum(self.dropped.values())

    @property
    def losses(self) -> dict[str, int]:
        """All dropped and lost messages, by reason."""
        return self.dropped | ({DropReason.LOST_ON_THE_WAY: self.lost} if self.lost else {})
