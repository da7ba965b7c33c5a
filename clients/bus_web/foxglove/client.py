"""One client, as all that belongs to its session speaks to it."""

from bus_web.foxglove import protocol
from bus_web.foxglove.protocol import Level
from bus_web.sender import Sender

__all__ = ["Client"]


class Client(Sender):
    """What it is sent: answers and news, messages of topics, and statuses."""

    def say(self, level: Level, text: str, id: str | None = None) -> None:
        """A status. Of one `id` the last holds."""
        self.notify(protocol.status(level, text, id))
