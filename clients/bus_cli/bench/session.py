"""The publishers and subscribers of one measurement: processes of a `Group`, the words sent to them, and
their events.

Knows the words of `bus_cli.bench.task`. Does not know the meaning of the figures.
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
"""A worker without progress for this time, plus two periods of its messages, counts as hanging."""

START_S = 0.5
"""More time for the start, for each process: all of them may share one CPU."""

_MODULE = "bus_cli.bench.worker"


class Session:
    """Runs `task.publishers` and `task.subscribers` processes; use it with `with`.

    `on_progress` gets the number of messages that all publishers have published in this Go. The methods raise
    Failure if a worker dies, hangs, or reports trouble.
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
        """Start all workers; returns the reports of the publishers when all are matched with all."""
        for number in range(self._task.subscribers):
            self._subscribers.append(self._start("subscriber", number))
        for number in range(self._task.publishers):
            self._publishers.append(self._start("publisher", number))
        self._silent_s = SILENT_S + START_S * len(self.workers)
        ready = self._collect(self.workers, Ready, {})
        self._silent_s = SILENT_S + (2 / self._task.rate if self._task.rate else 0.0)
        return ready[len(self._subscribers) :]

    def publish(self, go: Go) -> list[Sent]:
        """Let all publishers publish; returns their reports."""
        self._counts, self._sent = {}, {}
        return self._ask(self._publishers, go, Sent, self._sent)

    def stop_publishing(self) -> list[Sent]:
        """End an interrupted `publish`; returns the publishers' reports."""
        return self._ask(self._publishers, Stop(), Sent, self._sent)

    def settle(self, published: int) -> list[Settled]:
        """Wait until each message so far has arrived or is lost; returns the subscribers' reports."""
        return self._ask(self._subscribers, Settle(published=published), Settled, {})

    @property
    def workers(self) -> list[Child]:
        """All processes."""
        return [*self._subscribers, *self._publishers]

    def _start(self, role: str, number: int) -> Child:
        task = msgspec.json.encode(replace(self._task, role=role)).decode()
        name = f"{role} {number + 1}"
        worker = self._group.start(name, sys.executable, "-m", _MODULE, task)
        worker.name = f"{name} (pid {worker.pid})"
        return worker

    def _ask(self, workers: Sequence[Child], word: Word, kind: type[E], found: dict[Child, E]) -> list[E]:
        text = msgspec.json.encode(word).decode()
        with deferred():  # all workers get the word, or none
            for worker in workers:
                worker.send(text)
        return self._collect(workers, kind, found)

    def _collect(self, workers: Sequence[Child], kind: type[E], found: dict[Child, E]) -> list[E]:
        """Wait for an event of this `kind` from each of `workers`; returns the events in the workers' order.

        `found` has the events received so far, also after an interruption.
        """
        deadline = monotonic() + self._silent_s
        while True:
            with deferred():  # an interruption here would lose an event
                has_news = [self._take(worker, kind, found) for worker in self.workers]
            if len(found) == len(workers):
                return [found[worker] for worker in workers]
            if any(has_news):
                deadline = monotonic() + self._silent_s
            late = ", ".join(worker.name for worker in workers if worker not in found)
            complaint = f"gave up: no progress for {self._silent_s:g} s by {late}"
            self._group.wait_for_news(deadline, complaint)

    def _take(self, worker: Child, kind: type[E], found: dict[Child, E]) -> bool:
        """Handle the events of a worker; returns whether it made progress."""
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
    """The environment of workers that must use `route`."""
    environ = {**os.environ, "BUSD_AUTOSTART": "0"}
    if route == "socket":
        environ["BUS_ROUTE"] = "socket"
    elif route == "shm":
        environ.pop("BUS_ROUTE", None)
    return environ
