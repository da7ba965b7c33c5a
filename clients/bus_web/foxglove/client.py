"""One client, as seen by the parts of its session."""

from collections import OrderedDict

from bus_web.foxglove import protocol
from bus_web.foxglove.protocol import Level
from bus_web.outbox import Outbox
from bus_web.sender import Sender, Socket

__all__ = ["Client"]

_MOST_ANSWERS = 8 << 20
_MOST_STATUSES = 256
"""Statuses that are remembered; an older one may come again."""


class Client(Sender):
    """Sends answers, news, messages of topics, and statuses to the client."""

    def __init__(self, socket: Socket, outbox: Outbox) -> None:
        super().__init__(socket, outbox)
        self._said: OrderedDict[tuple[str, str | None], None] = OrderedDict()

    def say(self, level: Level, text: str, id: str | None = None) -> None:
        """A status. The last status with one `id` is valid.

        The same status is sent once: viewers list statuses until they are removed, and a mistake may be
        repeated with each message.
        """
        key = (text, id)
        if key in self._said:
            self._said.move_to_end(key)
            return
        self._said[key] = None
        if len(self._said) > _MOST_STATUSES:
            self._said.popitem(last=False)
        self.notify(protocol.status(level, text, id))

    def remove_status(self, id: str) -> None:
        """Remove the statuses with that `id`; each may come again."""
        for key in [one for one in self._said if one[1] == id]:
            del self._said[key]
        self.notify(protocol.text("removeStatus", statusIds=[id]))

    def answer(self, frame: bytes, otherwise: bytes) -> None:
        """Send an answer of any size, or `otherwise` if too much is queued already."""
        is_too_much = self.notice_bytes and self.notice_bytes + len(frame) > _MOST_ANSWERS
        self.notify(otherwise if is_too_much else frame)
