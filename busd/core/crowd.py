"""The subscriptions of one process to one publisher by socket: a run waits once for all of them.

If a publisher has many subscriptions, a run costs its process a step for each *process* that subscribes. The
subscribing process hands it to its subscriptions in its own turns (`busd.core.router`). So a process with
thousands of subscriptions delays itself, and no publisher. Runs that wait longer are gathered into fewer
runs. Whole runs are dropped if no subscription has room for them any more.

Owns the waiting runs and the position of each subscription. Decides nothing about queues and tells no process
anything.
"""

from bisect import insort
from collections.abc import Iterator
from typing import TypeAlias

import msgspec

from bus.base.ids import EndpointId
from bus.vocabulary import DropReason
from bus.wire.runs import Account, Run
from busd.core.history import GatheredRuns

__all__ = ["Crowd", "Loss", "News"]

_MOST_LOSSES = 64


class Loss(msgspec.Struct, order=True):
    """Samples that no subscription of the process gets; `reason` as for drops.

    NOT_SENT: the publisher has sent them by another route.
    """

    first_seq: int
    end_seq: int
    """The number after the last one."""
    reason: str


NOT_SENT = ""
"""In place of a reason: the publisher has not sent these samples to busd, and they are not lost."""

News: TypeAlias = Run | Loss
"""A piece of news for the members of a crowd."""


class Crowd:
    """`queued` is the account of the process, which pays for the waiting runs."""

    __slots__ = ("_depth", "_losses", "is_due", "members", "waiting")

    def __init__(self, queued: Account) -> None:
        self.members: dict[EndpointId, int] = {}
        """The subscriptions, each with the first sequence number that it may still need."""
        self.waiting = GatheredRuns(0, queued)
        self.is_due = False
        """Its process will have a turn for it."""
        self._depth = 1  # of the deepest member; 0: one is not bounded by number
        self._losses: list[Loss] = []  # by their numbers

    def join(self, number: EndpointId, depth: int, next_seq: int) -> None:
        """A subscription with that depth gets the samples from `next_seq` on."""
        self.members[number] = next_seq
        self._depth = max(self._depth, depth) if self._depth and depth else 0

    def leave(self, number: EndpointId) -> None:
        """A subscription gets no more; does nothing if it is not a member."""
        self.members.pop(number, None)
        if not self.members:
            self.waiting.clear()
            self._losses.clear()

    @property
    def has_news(self) -> bool:
        return bool(self.waiting.runs or self._losses)

    def append(self, run: Run) -> None:
        """`run` is for all members. The oldest waiting runs are dropped if no member has room for them."""
        waiting = self.waiting
        is_overfull = waiting.append(run)
        if self._depth:
            while waiting.count - waiting.runs[0].count >= self._depth:
                self._lose_oldest(DropReason.REPLACED)
        while is_overfull and len(waiting.runs) > 1:
            self._lose_oldest(DropReason.MEMORY_LIMIT)
            is_overfull = waiting.is_overfull

    def lose(self, reason: str, first_seq: int, end_seq: int) -> None:
        """The samples from `first_seq` up to the one before `end_seq` are lost for all members."""
        losses = self._losses
        for loss in reversed(losses):
            if loss.end_seq == first_seq and loss.reason == reason:
                loss.end_seq = end_seq
                return
            if loss.first_seq < first_seq:
                break
        insort(losses, Loss(first_seq, end_seq, reason))
        if len(losses) > _MOST_LOSSES and losses[0].end_seq == losses[1].first_seq:
            losses[1].first_seq = losses.pop(0).first_seq  # the count stays right, if not the reason

    def news(self) -> Iterator[News]:
        """The runs that wait for the members, the oldest first. Others may hold the runs from now on."""
        self.waiting.close()
        losses = iter(self._losses)
        loss = next(losses, None)
        for run in self.waiting.runs:
            while loss is not None and loss.first_seq < run.first_seq:
                yield loss
                loss = next(losses, None)
            yield run
        while loss is not None:
            yield loss
            loss = next(losses, None)

    def done(self, news: News, end_seq: int) -> None:
        """All members have had `news`, up to the number before `end_seq`."""
        if isinstance(news, Loss):
            news.first_seq = end_seq  # it may have grown meanwhile
            self._losses = [loss for loss in self._losses if loss.first_seq < loss.end_seq]
        elif self.waiting.runs and self.waiting.runs[0] is news:
            self.waiting.forget_head()

    def _lose_oldest(self, reason: str) -> None:
        run = self.waiting.runs[0]
        self.waiting.forget_head()
        self.lose(reason, run.first_seq, run.first_seq + run.count)
