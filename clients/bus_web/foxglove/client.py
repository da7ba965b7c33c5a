"""The client of a session, as far as its parts speak to it."""

from typing import Protocol

from bus_web.foxglove.protocol import Level

__all__ = ["Client"]


class Client(Protocol):
    """Who is told things."""

    def put(self, frame: bytes) -> None:
        """A frame that is of no topic."""

    def say(self, level: Level, text: str, id: str | None = None) -> None:
        """A status. Of one `id` the last holds."""
