"""The processes of one measurement: started, spoken with, and in every case ended and reaped.

Knows `bus_cli.bench.task`'s words, and not what the figures mean.
"""

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import Callable, Sequence
from tempfile import TemporaryFile
from types import TracebackType
from typing import IO, Any, Self, TypeVar

from msgspec import json
from msgspec.structs import replace

from bus_cli.bench.task import Event, Go, Progress, Ready, Sent, Settle, Settled, Stop, Task, Trouble, Word
from bus_cli.output import CommandError

__all__ = ["SILENT_S", "START_S", "Session", "worker_environ"]

E = TypeVar("E", Ready, Sent, Settled)

SILENT_S = 20.0
"""A worker that gets no further for so long, and for two of its messages' periods, hangs."""

START_S = 0.5
"""For each process, more than that until it has started: they may all share one CPU."""

_MODULE = "bus_cli.bench.worker"
_END_S = 2.0
_LONGEST_LINE = 1 << 30


class _Worker:
    """A process of ours."""

    def __init__(self, name: str, process: asyncio.subprocess.Process, log: IO[bytes]) -> None:
        self.name = name
        self.count = 0
        self.process = process
        self._log = log

    def tell(self, word: Word) -> None:
        """Say `word`; that it is gone is noticed by who waits for the answer."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.encode(word) + b"\n")

    async def describe_end(self) -> str:
        """How it ended, and its last words on stderr."""
        status = await self.process.wait()
        how = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        return f"{self.name} {how}" + (f": {lines[-1]}" if lines else "")

    async def end(self) -> None:
        """Ask it to end, kill it where it does not, and reap it. Cancellation: it is killed and reaped."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        try:
            async with asyncio.timeout(_END_S):
                await self.process.wait()
        except TimeoutError:
            pass
        finally:
            if self.process.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    self.process.kill()
                await self.process.wait()
            self._log.close()


class Session:
    """`task.publishers` and `task.subscribers` processes; use it as `async with`.

    `on_progress` gets the number of messages that all publishers have published in this Go. What the methods
    wait for raises CommandError where a worker dies, hangs, or says that it can't go on.
    """

    def __init__(self, task: Task, environ: dict[str, str], on_progress: Callable[[int], None]) -> None:
        self._task = task
        self._environ = environ
        self._on_progress = on_progress
        self._publishers: list[_Worker] = []
        self._subscribers: list[_Worker] = []
        self._events: asyncio.Queue[tuple[_Worker, Event | None]] = asyncio.Queue()
        self._readers: list[asyncio.Task[None]] = []
        self._sent: dict[_Worker, Sent] = {}
        self._silent_s = SILENT_S

    async def start(self) -> list[Ready]:
        """Start all; returns what the publishers say, when each is matched with each."""
        for number in range(self._task.subscribers):
            self._subscribers.append(await self._start("subscriber", number))
        for number in range(self._task.publishers):
            self._publishers.append(await self._start("publisher", number))
        self._silent_s = SILENT_S + START_S * len(self._workers)
        ready = await self._collect(self._workers, Ready, {})
        self._silent_s = SILENT_S + (2 / self._task.rate if self._task.rate else 0.0)
        return ready[len(self._subscribers) :]

    async def publish(self, go: Go) -> list[Sent]:
        """Let all publishers publish."""
        for worker in self._publishers:
            worker.count = 0
            worker.tell(go)
        self._sent = {}
        return await self._collect(self._publishers, Sent, self._sent)

    async def stop_publishing(self) -> list[Sent]:
        """End what `publish` has begun, after its cancellation."""
        for worker in self._publishers:
            worker.tell(Stop())
        return await self._collect(self._publishers, Sent, self._sent)

    async def settle(self, published: int) -> list[Settled]:
        """What the subscribers have, when each of all messages so far has come or is lost."""
        for worker in self._subscribers:
            worker.tell(Settle(published=published))
        return await self._collect(self._subscribers, Settled, {})

    @property
    def _workers(self) -> list[_Worker]:
        return [*self._subscribers, *self._publishers]

    async def _start(self, role: str, number: int) -> _Worker:
        task = replace(self._task, role=role)
        log = TemporaryFile()  # noqa: SIM115
        try:
            process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", _MODULE, json.encode(task).decode()),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=log,
                env=self._environ,
                limit=_LONGEST_LINE,
                start_new_session=True,  # Ctrl-C reaches only us, who end the others in order
            )
        except BaseException:
            log.close()
            raise
        worker = _Worker(f"{role} {number + 1} (pid {process.pid})", process, log)
        self._readers.append(asyncio.create_task(self._read(worker)))
        return worker

    async def _read(self, worker: _Worker) -> None:
        assert worker.process.stdout is not None
        async for line in worker.process.stdout:
            self._events.put_nowait((worker, json.decode(line, type=Event)))
        self._events.put_nowait((worker, None))

    async def _collect(self, workers: Sequence[_Worker], kind: type[E], found: dict[_Worker, E]) -> list[E]:
        """That event of each of them, in their order; `found` are those that came, also when cancelled."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + self._silent_s
        while len(found) < len(workers):
            try:
                async with asyncio.timeout_at(deadline_s):
                    worker, event = await self._events.get()
            except TimeoutError:
                late = ", ".join(worker.name for worker in workers if worker not in found)
                raise CommandError(f"gave up: no progress for {self._silent_s:g} s by {late}") from None
            if event is None:
                raise CommandError(await worker.describe_end())
            if isinstance(event, Trouble):
                raise CommandError(event.text)
            if isinstance(event, Progress):
                if event.count == worker.count:
                    continue
                worker.count = event.count
                self._on_progress(sum(one.count for one in self._publishers))
            elif isinstance(event, kind):
                found[worker] = event
            deadline_s = loop.time() + self._silent_s
        return [found[worker] for worker in workers]

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # Together: one that hangs costs its time once. Shielded: a second Ctrl-C leaves nobody behind.
        ending: asyncio.Future[Any] = asyncio.gather(*(worker.end() for worker in self._workers))
        try:
            await asyncio.shield(ending)
        except asyncio.CancelledError:
            for worker in self._workers:
                if worker.process.returncode is None:
                    worker.process.kill()
            await ending
            raise
        finally:
            for reader in self._readers:
                reader.cancel()
            await asyncio.gather(*self._readers, return_exceptions=True)


def worker_environ(route: str | None) -> dict[str, str]:
    """The environment of workers that are to use `route`."""
    environ = {**os.environ, "BUSD_AUTOSTART": "0"}
    if route == "socket":
        environ["BUS_ROUTE"] = "socket"
    elif route == "shm":
        environ.pop("BUS_ROUTE", None)
    return environ
