"""Asks the far side for missing parts, and asks again if no answer comes."""

import asyncio
from collections.abc import Callable
from functools import partial

from bus_bridge.zenoh import records
from bus_bridge.zenoh.arrival import Arrival
from bus_bridge.zenoh.session import Session

__all__ = ["AGAIN_S", "ASK_S", "Missing"]

ASK_S = 1.0
"""Time to wait for an answer."""
AGAIN_S = 0.1
"""Pause after a question without an answer."""
_FIRST, _MOST = 4, 16
"""Number of missing parts to ask for at a time: at first, and at most. It grows with each answer.

zenoh drops many parts in a row, and one question for each would cost a round trip each.
"""


class Missing:
    """The missing parts of `arrival`, asked for at `key`. `on_answer` gets each part's number, payload and
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
        """Numbers of parts with a pending question."""
        self._most = _FIRST
        self._is_closed = False

    def ask(self) -> None:
        """Ask for missing parts, but only for a limited number at a time."""
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
            self._most = 1  # the link is full or slow
            asyncio.get_running_loop().call_later(AGAIN_S, self._ask_again, number)
            return
        self._most = min(self._most + 1, _MOST)
        self._asked_for.discard(number)
        self._on_answer(number, payload, head)

    def _ask_again(self, number: int) -> None:
        self._asked_for.discard(number)
        if not self._is_closed:
            self.ask()
