"""Asks the far side for missing parts, and asks again if no answer comes."""

import asyncio
from collections.abc import Callable
from functools import partial

from bus_bridge.zenoh import records
from bus_bridge.zenoh.arrival import Arrival
from bus_bridge.zenoh.session import Session

__all__ = ["AGAIN_S", "ASK_S", "Missing"]

ASK_S = 1.0
"""How long an answer is waited for."""
AGAIN_S = 0.1
"""After a question without an answer."""
_FIRST, _MOST = 4, 16
"""Missing parts that are asked for at a time: zenoh drops many in a row, and each alone would cost a way
there and back. More while answers come."""


class Missing:
    """The parts that `arrival` lacks, asked for at `key`. `on_answer` gets each part's number, payload and
    head."""

    def __init__(
        self,
        session: Session,
        key: str,
        arrival: Arrival,
        on_answer: Callable[[int, bytes, bytes | None], None],
    ) -> None:
        self._session = session
        self._key = key
        self._arrival = arrival
        self._on_answer = on_answer
        self._asked_for: set[int] = set()
        """Numbers of parts that are on their way here, as answers."""
        self._most = _FIRST
        self._is_closed = False

    def ask(self) -> None:
        """Ask for missing parts, but not for too many at a time."""
        if len(self._asked_for) >= self._most:
            return
        for number in self._arrival.missing(self._most):
            if number not in self._asked_for:
                self._asked_for.add(number)
                question = b"p" + records.write_pair(number - 1, 0)
                self._session.ask(self._key, question, ASK_S, partial(self._answer, number))

    def close(self) -> None:
        """Ignore further answers."""
        self._is_closed = True

    def _answer(self, number: int, payload: bytes | None, head: bytes | None) -> None:
        if self._is_closed:
            return
        if payload is None:
            self._most = 1  # the link is full, or slow
            asyncio.get_running_loop().call_later(AGAIN_S, self._ask_again, number)
            return
        self._most = min(self._most + 1, _MOST)
        self._asked_for.discard(number)
        self._on_answer(number, payload, head)

    def _ask_again(self, number: int) -> None:
        self._asked_for.discard(number)
        if not self._is_closed:
            self.ask()
