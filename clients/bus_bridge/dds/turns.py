"""The order in which many calls of one client are made, so that the far server gets few at once.

Owns: the calls that wait. Must not know: what a call is.
"""

import asyncio
from collections import deque
from typing import Final

__all__ = ["Turns"]

_PAUSE_S: Final = 0.1


class Turns:
    """Calls that wait until they are made, in their order.

    The next one is made when an open call has ended (`next`), or after a pause: a server may work on many
    calls at the same time.
    """

    def __init__(self) -> None:
        self._waiting: deque[asyncio.Future[None]] = deque()
        self._pause: asyncio.TimerHandle | None = None

    def __len__(self) -> int:
        return len(self._waiting)

    async def wait(self) -> None:
        """Wait for a turn. Cancellation gives it up."""
        loop = asyncio.get_running_loop()
        turn = loop.create_future()
        self._waiting.append(turn)
        if self._pause is None:
            self._pause = loop.call_later(_PAUSE_S, self._pause_ended)
        try:
            await turn
        except asyncio.CancelledError:
            if turn in self._waiting:
                self._waiting.remove(turn)
                self._settle()
            else:  # it had its turn already: the next one gets it
                self.next()
            raise

    def next(self) -> None:
        """Give the next one its turn, if one waits."""
        while self._waiting:
            turn = self._waiting.popleft()
            if not turn.done():
                turn.set_result(None)
                break
        self._settle()

    def end(self) -> None:
        """Give all their turn."""
        while self._waiting:
            self.next()

    def _settle(self) -> None:
        if not self._waiting and self._pause is not None:
            self._pause.cancel()
            self._pause = None

    def _pause_ended(self) -> None:
        self._pause = asyncio.get_running_loop().call_later(_PAUSE_S, self._pause_ended)
        self.next()
