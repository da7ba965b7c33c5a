"""Counters of all messages of one route: taken = sent + waiting + dropped, by reason. Pure."""

from bus.vocabulary import DropReason

__all__ = ["Account"]


class Account:
    """The counters of one route."""

    __slots__ = ("bytes", "dropped", "lost", "sent", "taken")

    def __init__(self) -> None:
        self.taken = 0
        self.sent = 0
        self.bytes = 0
        """Bytes of payload in sent messages."""
        self.dropped: dict[str, int] = {}
        """Taken messages that were dropped, by reason."""
        self.lost = 0
        """Messages lost before they reached the bridge."""

    def drop(self, reason: DropReason, count: int = 1) -> None:
        if count:
            self.dropped[reason] = self.dropped.get(reason, 0) + count

    @property
    def waiting(self) -> int:
        """Number of messages that were neither sent nor dropped."""
        return self.taken - self.sent - sum(self.dropped.values())

    @property
    def losses(self) -> dict[str, int]:
        """All dropped and lost messages, by reason."""
        return self.dropped | ({DropReason.LOST_ON_THE_WAY: self.lost} if self.lost else {})
