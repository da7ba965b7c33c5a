"""The turns of calls of one service. They keep the queue of its server in ROS 2 from overflowing.

Owns: the waiting calls, and the calls that may be in the server's queue. Must not know: their content.

A server takes requests in their order. So an answer shows that no earlier request is in its queue any more.
An earlier request without an answer is lost, or the server works on many calls at the same time.
"""

import asyncio
from collections import deque
from typing import Final
from weakref import WeakValueDictionary

__all__ = ["Turns", "TurnsOfServices"]

_AT_ONCE: Final = 8
"""A server of ROS 2 keeps ten requests that it has not taken, and drops the oldest ones without a report."""
_PAUSE_S: Final = 0.1
_GROWTH: Final = 4.0


class Turns:
    """Calls of all our clients of a service.

    While eight calls may be in the server's queue, further ones wait until an open call has ended. After a
    pause without an answer one more call is made: a server may work on many calls at the same time. Each
    further call without an answer makes the pause `growth` times as long.
    """

    def __init__(self, growth: float = _GROWTH) -> None:
        self._growth = growth
        self._last = 0
        self._queued: dict[int, None] = {}
        """Numbers of calls that may be in the server's queue, in order."""
        self._waiting: deque[tuple[asyncio.Future[int], object]] = deque()
        self._pause: asyncio.TimerHandle | None = None

    def __len__(self) -> int:
        """The number of waiting calls."""
        return len(self._waiting)

    async def begin(self, client: object) -> int:
        """Wait for a turn; returns its number, for `ended`. Cancellation gives it up."""
        turn = asyncio.get_running_loop().create_future()
        self._waiting.append((turn, client))
        self._settle()
        try:
            number: int = await turn
        except asyncio.CancelledError:
            if turn.done() and not turn.cancelled():
                self.ended(turn.result())
            else:
                self._waiting = deque(one for one in self._waiting if one[0] is not turn)
                self._settle()
            raise
        return number

    def answered(self, number: int) -> None:
        """There is an answer to the call with this number."""
        for one in [one for one in self._queued if one <= number]:
            del self._queued[one]
        self._stop_pause()
        self._settle()

    def ended(self, number: int) -> None:
        """The call with this number has ended in any way. A second call has no effect."""
        self._queued.pop(number, None)
        self._settle()

    def leave(self, client: object) -> None:
        """Give all calls of a client their turn: the client is closed."""
        for turn, owner in [one for one in self._waiting if one[1] is client]:
            self._waiting.remove((turn, owner))
            self._give(turn)
        self._settle()

    def _settle(self) -> None:
        while self._waiting and len(self._queued) < _AT_ONCE:
            self._give(self._waiting.popleft()[0])
        if not self._waiting:
            self._stop_pause()
        elif self._pause is None:
            pause_s = _PAUSE_S * self._growth ** min(len(self._queued) - _AT_ONCE, 8)
            self._pause = asyncio.get_running_loop().call_later(pause_s, self._pause_ended)

    def _give(self, turn: "asyncio.Future[int]") -> None:
        if not turn.done():
            self._last += 1
            self._queued[self._last] = None
            turn.set_result(self._last)

    def _stop_pause(self) -> None:
        if self._pause is not None:
            self._pause.cancel()
            self._pause = None

    def _pause_ended(self) -> None:
        self._pause = None
        self._give(self._waiting.popleft()[0])
        self._settle()


class TurnsOfServices:
    """The turns of each service: all our clients of a service share them."""

    def __init__(self) -> None:
        self._found: WeakValueDictionary[str, Turns] = WeakValueDictionary()

    def find(self, service: str, *, is_of_results: bool) -> Turns:
        """The turns of a service, by a text that only this service has.

        `is_of_results`: by this service an action gives results. Its server takes requests at once, and
        answers when the goals end, so the pauses do not grow.
        """
        found = self._found.get(service)
        if found is None:
            found = self._found[service] = Turns(1.0) if is_of_results else Turns()
        return found
