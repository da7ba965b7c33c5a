"""The publishers and subscribers of one measurement: processes of a `Group`, the words sent to them, and
their events.

Knows `bus_cli.bench.task`'s words, and not what the figures mean.
"""

import os
import sys
from collections.abc import Callable, Sequence
from time import monotonic
from types import TracebackType
from typing import Self, TypeVar

import msgspec
from msgspec.structs import replace

from bus_cli.bench.harness import Child, Failure, Group
from bus_cli.bench.interrupts import deferred
from bus_cli.bench.task import Event, Go, Progress, Ready, Sent, Settle, Settled, Stop, Task, Trouble, Word

__all__ = ["SILENT_S", "START_S", "Session", "worker_environ"]

E = TypeVar("E", Ready, Sent, Settled)

SILENT_S = 20.0
"""A worker that gets no further for so long, and for two of its messages' periods, hangs."""

START_S = 0.5
"""For each process, more than that until it has started: they may all share one CPU."""

_MODULE = "bus_cli.bench.worker"


class Session:
    """`task.publishers` and `task.subscribers` processes; use it as `with`.

    `on_progress` gets the number of messages that all publishers have published in this Go. What the methods
    wait for raises Failure where a worker dies, hangs, or says that it can't go on.
    """

    def __init__(self, task: Task, environ: dict[str, str], on_progress: Callable[[int], None]) -> None:
        self._task = task
        self._on_progress = on_progress
        self._group = Group()
        self._group.environ = environ
        self._publishers: list[Child] = []
        self._subscribers: list[Child] = []
        self._counts: dict[Child, int] = {}
        self._sent: dict[Child, Sent] = {}
        self._silent_s = SILENT_S

    def start(self) -> list[Ready]:
        """Start all; returns what the publishers say, when each is matched with each."""
        for number in range(self._task.subscribers):
            self._subscribers.append(self._start("subscriber", number))
        for number in range(self._task.publishers):
            self._publishers.append(self._start("publisher", number))
        self._silent_s = SILENT_S + START_S * len(self.workers)
        ready = self._collect(self.workers, Ready, {})
        self._silent_s = SILENT_S + (2 / self._task.rate if self._task.rate else 0.0)
        return ready[len(self._subscribers) :]

    def publish(self, go: Go) -> list[Sent]:
        """Let all publishers publish."""
        self._counts, self._sent = {}, {}
        return self._ask(self._publishers, go, Sent, self._sent)

    def stop_publishing(self) -> list[Sent]:
        """End what `publish` has begun, after its interruption."""
        return self._ask(self._publishers, Stop(), Sent, self._sent)

    def settle(self, published: int) -> list[Settled]:
        """What the subscribers have, when each of all messages so far has come or is lost."""
        return self._ask(self._subscribers, Settle(published=published), Settled, {})

    @property
    def workers(self) -> list[Child]:
        """All of them."""
        return [*self._subscribers, *self._publishers]

    def _start(self, role: str, number: int) -> Child:
        task = msgspec.json.encode(replace(self._task, role=role)).decode()
        name = f"{role} {number + 1}"
        worker = self._group.start(name, sys.executable, "-m", _MODULE, task)
        worker.name = f"{name} (pid {worker.pid})"
        return worker

    def _ask(self, workers: Sequence[Child], word: Word, kind: type[E], found: dict[Child, E]) -> list[E]:
        text = msgspec.json.encode(word).decode()
        with deferred():  # all of them or none
            for worker in workers:
                worker.send(text)
        return self._collect(workers, kind, found)

    def _collect(self, workers: Sequence[Child], kind: type[E], found: dict[Child, E]) -> list[E]:
        """That event of each of them, in their order; `found` are those that came, also when interrupted."""
        deadline = monotonic() + self._silent_s
        while True:
            with deferred():  # no event gets lost
                has_news = [self._take(worker, kind, found) for worker in self.workers]
            if len(found) == len(workers):
                return [found[worker] for worker in workers]
            if any(has_news):
                deadline = monotonic() + self._silent_s
            late = ", ".join(worker.name for worker in workers if worker not in found)
            complaint = f"gave up: no progress for {self._silent_s:g} s by {late}"
            self._group.wait_for_news(deadline, complaint)

    def _take(self, worker: Child, kind: type[E], found: dict[Child, E]) -> bool:
        """Take what it has said; returns whether it got any further."""
        has_news = False
        while worker.events:
            event: Event = msgspec.convert(worker.events.pop(0), Event)
            if isinstance(event, Trouble):
                raise Failure(event.text)
            if isinstance(event, Progress):
                if event.count == self._counts.get(worker, 0):
                    continue
                self._counts[worker] = event.count
                self._on_progress(sum(self._counts.values()))
            elif isinstance(event, kind):
                found[worker] = event
            has_news = True
        return has_news

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._group.__exit__(kind, error, trace)


def worker_environ(route: str | None) -> dict[str, str]:
    """The environment of workers that are to use `route`."""
    environ = {**os.environ, "BUSD_AUTOSTART": "0"}
    if route == "socket":
        environ["BUS_ROUTE"] = "socket"
    elif route == "shm":
        environ.pop("BUS_ROUTE", None)
    return environ
