"""The part of a client of ROS 2's services that does not depend on the middleware.

Owns: the wait for a server, the bound of open calls, and the turn of each call. Must not know: how a request
is sent, and which server it goes to.
"""

import asyncio
from abc import ABC, abstractmethod
from typing import Final, Generic, TypeVar

from bus_bridge.errors import BridgeError
from bus_bridge.ros2.calls import NoServer, Response
from bus_bridge.ros2.turns import Turns

__all__ = ["CallingClient"]

_MOST_CALLS: Final = 10_000
"""Calls of one client without an answer."""
_POLL_S: Final = 0.01
_LONGEST_POLL_S: Final = 0.2

C = TypeVar("C")


class CallingClient(ABC, Generic[C]):
    """A client in ROS 2. Texts call its service `name`. A call that was sent is a `C`."""

    def __init__(self, name: str, turns: Turns) -> None:
        self._name = name
        self._turns = turns
        self._calls: dict[int, C] = {}
        """Calls that were sent, by their numbers."""
        self._in_line = 0
        """Calls that wait for their turn."""
        self._is_closed = False

    @property
    def waiting(self) -> int:
        """The number of calls without an answer."""
        return len(self._calls) + self._in_line

    @property
    @abstractmethod
    def is_ready(self) -> bool:
        """Whether a server is there, and gets requests of this client."""

    async def wait_until_ready(self) -> None:
        """Wait for a server. Raises NoServer if the client is closed. Cancellation leaves nothing behind."""
        pause_s = _POLL_S
        while not self.is_ready:
            if self._is_closed:
                raise NoServer(f"the client of {self._name} is closed")
            # No middleware notifies us when it has connected both ends; it takes milliseconds.
            await asyncio.sleep(pause_s)
            pause_s = min(1.5 * pause_s, _LONGEST_POLL_S)

    async def call(self, cdr: bytes) -> Response:
        """Make a call. There is no time limit.

        Raises NoServer if there is no server, or if it leaves without an answer. Raises BridgeError for too
        many calls at once. Cancellation gives the call up.
        """
        if self.waiting >= _MOST_CALLS:
            raise BridgeError(f"{_MOST_CALLS} calls of {self._name} wait for an answer, which is the limit")
        self._in_line += 1
        try:
            turn = await self._turns.begin(self)
        finally:
            self._in_line -= 1
        try:
            answer = await self._ask(cdr)
            self._turns.answered(turn)
        finally:
            self._turns.ended(turn)
        return answer

    @abstractmethod
    async def _ask(self, cdr: bytes) -> Response:
        """Send a request, and wait for its answer."""
