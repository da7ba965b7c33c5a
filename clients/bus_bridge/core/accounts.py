"""What became of each message of one route: taken is sent, waiting, and dropped by reason. Pure."""

__all__ = [
    "DISCONNECTED",
    "EXPIRED",
    "LOST",
    "MEMORY",
    "NOT_WANTED",
    "RATE",
    "REFUSED",
    "REPEATED",
    "REPLACED",
    "TOO_LARGE",
    "Account",
]

REPLACED = "replaced"
"""The bridge's own queue was full: the oldest goes."""
MEMORY = "memory_limit"
"""The bridge's own queue had too many bytes."""
RATE = "rate_limit"
"""A rule allows fewer messages in a second."""
NOT_WANTED = "not_wanted"
"""No subscription on the other side is matched with the publisher."""
DISCONNECTED = "disconnected"
"""Its publisher, or the way to the far side, went before it could go on."""
REPEATED = "repeated"
"""It had come before."""
EXPIRED = "expired"
"""It was older than its lifespan when it came."""
TOO_LARGE = "too_large"
"""Larger than this bus allows."""
REFUSED = "refused"
"""This bus did not take it; the bridge's log says why."""
LOST = "lost_on_the_way"
"""Its number is missing in what came: it never was in this bridge, and counts as none of `taken`."""


class Account:
    """The counters of one route."""

    __slots__ = ("bytes", "dropped", "lost", "sent", "taken")

    def __init__(self) -> None:
        self.taken = 0
        self.sent = 0
        self.bytes = 0
        """Of payload, of what was sent."""
        self.dropped: dict[str, int] = {}
        """By reason; of what was taken."""
        self.lost = 0
        """Lost before it came here."""

    def drop(self, reason: str, count: int = 1) -> None:
        if count:
            self.dropped[reason] = self.dropped.get(reason, 0) + count

    @property
    def waiting(self) -> int:
        """What has neither gone on nor been dropped."""
        return self.taken - self.sent - sum(self.dropped.values())

    @property
    def losses(self) -> dict[str, int]:
        """All that did not go on, by reason."""
        return self.dropped | ({LOST: self.lost} if self.lost else {})
