"""One client, as seen by the parts of its session."""

from bus_web.foxglove import protocol
from bus_web.foxglove.protocol import Level
from bus_web.sender import Sender

__all__ = ["Client"]

_MOST_ANSWERS = 8 << 20


class Client(Sender):
    """Sends answers, news, messages of topics, and statuses to the client."""

    def say(self, level: Level, text: str, id: str | None = None) -> None:
        """A status. The last status with one `id` is valid."""
        self.notify(protocol.status(level, text, id))

    def answer(self, frame: bytes, otherwise: bytes) -> None:
        """Send an answer of any size, or `otherwise` if too much is queued already."""
        is_too_much = self.notice_bytes and self.notice_bytes + len(frame) > _MOST_ANSWERS
        self.notify(otherwise if is_too_much else frame)
