"""What has arrived from one far publisher, in order and without what came before. Pure.

A route that keeps something over there (reliable, or transient local) begins by asking for it; what arrives
meanwhile is held. A reliable route asks again whenever a put names a message before it that never came.
"""

from collections import deque
from collections.abc import Sequence

from bus_bridge.engine import Sample

__all__ = ["HELD_BYTES", "Arrival"]

HELD_BYTES = 16 << 20
"""That may wait for an answer: more than is ever under way."""


class Arrival:
    """`reliable`: puts name the message before them. `asks`: something is kept over there."""

    def __init__(self, *, reliable: bool, asks: bool) -> None:
        self.last = 0
        """Number of the last message that has gone on."""
        self.asking = asks
        """Whether the far side has to be asked for what comes after `last`."""
        self.dropped = 0
        """Messages that could not be held; a reliable route gets them by asking."""
        self._reliable = reliable
        self._held: deque[tuple[int, Sequence[Sample]]] = deque()
        self._held_bytes = 0

    def arrive(self, samples: Sequence[Sample], previous: int) -> Sequence[Sample]:
        """A put has come. The messages that may go on."""
        if self._reliable and previous > self.last:
            self.asking = True
        elif self._reliable or not self.asking:
            return self._pass(samples)
        self._hold(samples, previous)
        return ()

    def answer(self, samples: Sequence[Sample], newest: int) -> Sequence[Sample]:
        """The far side has answered with what comes after `last`, up to a batch; `newest`: the number of the
        newest message that it has sent to anybody. The messages that may go on."""
        gone = list(self._newer(samples))
        if gone:
            self.last = gone[-1].number
        if samples and self.last < newest and not self._reaches():
            return gone  # there is more: ask on
        if self._reliable and not samples:
            self.last = max(self.last, newest)  # what is not kept for us is not for us
        self.asking = False
        while self._held:
            previous, held = self._held[0]
            if self._reliable and previous > self.last:
                self.asking = True
                break
            self._held.popleft()
            self._held_bytes -= _size(held)
            more = self._newer(held)
            if more:
                gone += more
                self.last = more[-1].number
        return gone

    def _reaches(self) -> bool:
        """Whether what is held goes on where `last` is."""
        return self._reliable and bool(self._held) and self._held[0][0] <= self.last

    def _newer(self, samples: Sequence[Sample]) -> Sequence[Sample]:
        if not samples or samples[0].number > self.last:
            return samples
        return [one for one in samples if one.number > self.last]

    def _pass(self, samples: Sequence[Sample]) -> Sequence[Sample]:
        if self._reliable:
            samples = self._newer(samples)  # sent a second time
        if samples:
            self.last = samples[-1].number
        return samples

    def _hold(self, samples: Sequence[Sample], previous: int) -> None:
        self._held.append((previous, samples))
        self._held_bytes += _size(samples)
        while self._held_bytes > HELD_BYTES and len(self._held) > 1:
            # Of a reliable route the newest goes: what is held must begin where the answers end.
            _, lost = self._held.pop() if self._reliable else self._held.popleft()
            self._held_bytes -= _size(lost)
            if not self._reliable:
                self.dropped += len(lost)


def _size(samples: Sequence[Sample]) -> int:
    return sum(len(one.payload) for one in samples)
