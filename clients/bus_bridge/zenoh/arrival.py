"""What has arrived from one far publisher: parts in order, each once. Pure.

A route begins by asking where it begins, and for what the far side keeps; what arrives meanwhile is held. It
asks again whenever a part is missing before one that has come.
"""

from bus_bridge.zenoh.records import Content, Probe

__all__ = ["HELD_BYTES", "Arrival"]

HELD_BYTES = 16 << 20
"""That may wait for what is missing: more than is ever under way."""


class Arrival:
    def __init__(self) -> None:
        self.last = 0
        """Number of the last part that has gone on."""
        self.is_begun = False
        """Whether it is known where the route begins."""
        self._held: dict[int, tuple[Content, int]] = {}
        self._held_bytes = 0
        self._newest = 0

    @property
    def misses(self) -> bool:
        """Whether the far side has to be asked for the part behind `last`."""
        return self.is_begun and self._newest > self.last

    def begin(self, base: int) -> list[Content]:
        """What comes behind the part `base` is for us. What may go on."""
        self.is_begun, self.last = True, base
        for number in [one for one in self._held if one <= base]:
            self._held_bytes -= self._held.pop(number)[1]
        return self._flush()

    def arrive(self, number: int, content: Content, size: int) -> list[Content]:
        """A part has come, of so many bytes. What may go on."""
        if isinstance(content, Probe):
            self._newest = max(self._newest, number)
            return []
        if self.is_begun:
            if number <= self.last:  # a second time
                return []
            if number == self.last + 1:
                self.last = number
                self._newest = max(self._newest, number)
                return [content, *self._flush()] if self._held else [content]
        self._newest = max(self._newest, number)
        if number not in self._held and self._held_bytes + size <= HELD_BYTES:  # else it is asked for
            self._held[number] = content, size
            self._held_bytes += size
        return []

    def skip(self) -> list[Content]:
        """What is missing is kept by nobody: go on with what is there."""
        self.last = min(self._held, default=self._newest + 1) - 1
        return self._flush()

    def _flush(self) -> list[Content]:
        gone = list[Content]()
        while self.last + 1 in self._held:
            self.last += 1
            content, size = self._held.pop(self.last)
            self._held_bytes -= size
            gone.append(content)
        return gone
