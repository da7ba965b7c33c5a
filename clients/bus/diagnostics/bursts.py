"""Bursts: warns that messages were lost because a program published them without a pause.

A loop of `publish` without an await is the most common reason for lost messages under keep last: it fills a
short queue faster than any subscription empties it. This reads counters that exist anyway, so it adds no cost
to a message.
"""

from collections.abc import Callable
from time import monotonic

from bus.logger import Logger

__all__ = ["MANY", "BurstWatch"]

MANY = 1000
_REST_S = 60.0


class BurstWatch:
    """Watches one publisher. `soon(call, *args)` makes a call after this turn of the event loop.

    `is_awaitable`: the user may await, which a user of rclpy can't.
    """

    def __init__(
        self, soon: Callable[..., object], topic: str, logger: Logger, *, is_awaitable: bool
    ) -> None:
        self._soon = soon
        self._topic = topic
        self._logger = logger
        self._is_awaitable = is_awaitable
        self._replaced = 0  # in this turn of the event loop
        self._said_at = -_REST_S

    def note_replaced(self, count: int, depth: int) -> None:
        """Note messages replaced in the publisher's own queue."""
        if not self._replaced:
            self._soon(self._end_turn)
        self._replaced += count
        if self._replaced >= MANY:
            self._say(
                f"{self._replaced:,} messages on '{self._topic}', published without a pause, were replaced "
                f"in the publisher's own queue, which keeps the last {depth}"
            )

    def watch_turn(self, published: Callable[[], int], least_depth: Callable[[], int]) -> None:
        """After a publish: when this turn of the event loop ends, check the number of messages published in
        it.

        `least_depth`: the smallest depth of the subscriptions; 0 if none may lose any.
        """
        self._soon(self._end_watch, published() - 1, published, least_depth)

    def _end_watch(self, before: int, published: Callable[[], int], least_depth: Callable[[], int]) -> None:
        count = published() - before
        if count >= MANY and 0 < (depth := least_depth()) < count:
            self._say(
                f"{count:,} messages on '{self._topic}' were published without a pause, and a subscription "
                f"that keeps the last {depth} loses those that it does not take in time"
            )

    def _end_turn(self) -> None:
        self._replaced = 0

    def _say(self, text: str) -> None:
        if (now := monotonic()) < self._said_at + _REST_S:
            return
        self._said_at = now
        how = "pause in between, raise the depth, or lose none by reliable + keep all"
        self._logger.warning(f"{text}: {how}{' and await send()' if self._is_awaitable else ''}")
