"""One client, as all that belongs to its session speaks to it."""

from bus_web.foxglove import protocol
from bus_web.foxglove.protocol import Level
from bus_web.sender import Sender

__all__ = ["Client"]

_MOST_ANSWERS = 8 << 20


class Client(Sender):
    """What it is sent: answers and news, messages of topics, and statuses."""

    def say(self, level: Level, text: str, id: str | None = None) -> None:
        """A status. Of one `id` the last holds."""
        self.notify(protocol.status(level, text, id))

    def answer(self, frame: bytes, otherwise: bytes) -> None:
        """What it has asked for, however large; `otherwise` where too much waits already."""
        is_too_much = self.notice_bytes and self.notice_bytes + len(frame) > _MOST_ANSWERS
        self.notify(otherwise if is_too_much else frame)
