"""An actor: a process with a node that publishes and listens, and checks every received message.

`stage` starts it as a fork of a process with all imports. It writes forbidden events to the file of faults at
once. Its published numbers are in a file, which outlives it.
"""

import asyncio
import contextlib
import ctypes
import gc
import logging
import os
import random
import resource
import socket
import sys
import time
from collections import Counter
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any, NoReturn

import msgspec

import bus
from bus.logger import TOP_NAME
from bus.runner import loop_factory
from bus.types.support import type_support
from chaos import cgroup
from chaos.proxy import Proxy
from chaos.roles import Ear, EarLook, Heard, Look, Parcel, Role, Talker, checksum
from survivors import Ledger
from zygote import serve

BEGUN, DONE = 0, 1
"""Positions in a talker's ledger: the numbers of the last begun and of the last finished publish."""

_LIBC = ctypes.CDLL(None)
_BLOCK = random.Random(1).randbytes(8 << 20)
_STARVED = (MemoryError, OSError, bus.BusError)
"""Errors that are possible in a limited process."""


class Speaking:
    """A talker that publishes while it may."""

    def __init__(self, actor: "Actor", talker: Talker, publisher: bus.Publisher[Parcel]) -> None:
        self.talker = talker
        self.publisher = publisher
        self.number = 0
        self._actor = actor
        self._chance = random.Random(talker.number)
        self._ledger = Ledger(f"{talker.number}.ledger")
        self._may = asyncio.Event()
        self._rests = asyncio.Event()
        self._task = actor.start(self._speak())

    def go(self) -> None:
        self._rests.clear()
        self._may.set()

    async def rest(self) -> int:
        """Stop; returns the number up to which everything is published and handed over."""
        self._may.clear()
        await self._rests.wait()
        await self.publisher.flush()
        return self.number

    async def speak_once(self) -> None:
        await self._publish(self._parcel(self.number + 1))
        await self.publisher.flush()

    async def close(self) -> None:
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        await self.publisher.close()
        self._ledger.close()

    async def _speak(self) -> None:
        talker = self.talker
        while True:
            if not self._may.is_set():
                self._rests.set()
                await self._may.wait()
            for _ in range(self._chance.randint(1, talker.burst)):
                await self._publish(self._parcel(self.number + 1))
            await asyncio.sleep(talker.pause_s * self._chance.random())

    async def _publish(self, parcel: Parcel) -> None:
        self._ledger.note(BEGUN, parcel.number)
        try:
            if not self.publisher.publish(parcel):
                await self.publisher.send(parcel)
        except _STARVED as error:
            self._actor.suffer(error)
            self.number = parcel.number  # by then, it may have gone one of two ways
            await asyncio.sleep(0.01)
            return
        self.number = parcel.number
        self._ledger.note(DONE, parcel.number)

    def _parcel(self, number: int) -> Parcel:
        least, most = self.talker.sizes
        size = int(least * (most / least) ** self._chance.random())  # log-uniform
        if self._chance.random() < 0.3:
            size = least
        begin = self._chance.randrange(len(_BLOCK) - size)
        body = _BLOCK[begin : begin + size]
        return Parcel(self.talker.number, number, checksum(self.talker.number, number, body), body)


class Listening:
    """A subscription with a check of its messages."""

    def __init__(self, actor: "Actor", ear: Ear) -> None:
        self.ear = ear
        self.heard: dict[int, Heard] = {}
        self._actor = actor
        self._task: asyncio.Task[None] | None = None

    async def open(self, node: bus.Node) -> None:
        ear = self.ear
        self.subscription = await node.create_subscription(
            Parcel,
            ear.topic,
            ear.quality.profile(),
            self._hear if ear.calls_back else None,
            views=ear.has_views,
        )
        if not ear.calls_back:
            self._task = self._actor.start(self._iterate())

    async def close(self) -> None:
        await self.subscription.close()
        if self._task is not None:
            await self._task

    def look(self) -> EarLook:
        found = self.subscription.statistics()
        return EarLook(found.delivered, found.queued, found.dropped, found.expected, self.heard)

    async def _iterate(self) -> None:
        async for parcel in self.subscription:
            self._hear(parcel)
            del parcel  # its views keep a ring mapped

    def _hear(self, parcel: Parcel) -> None:
        talker, number = parcel.talker, parcel.number
        if parcel.checksum != checksum(talker, number, parcel.body):
            self._actor.complain(f"ear {self.ear.number}: {talker}'s {number} is torn")
        heard = self.heard.get(talker)
        if heard is None:
            heard = self.heard[talker] = Heard(first=number, last=number - 1)
        if number <= heard.last:
            self._actor.complain(f"ear {self.ear.number}: {talker}'s {number} after {heard.last}")
            return
        heard.missing += number - heard.last - 1
        heard.messages += 1
        heard.last = number


class Actor:
    """Carries out orders one after the other."""

    def __init__(self, role: Role, node: bus.Node, proxy: Proxy | None) -> None:
        self.role = role
        self._proxy = proxy
        self._node = node
        self._speaking: dict[int, Speaking] = {}
        self._listening: dict[int, Listening] = {}
        self._errors: Counter[str] = Counter()
        self._losses = _Losses()
        logging.getLogger(TOP_NAME).addHandler(self._losses)

    async def do(self, order: str, value: Any) -> Any:
        match order:
            case "go":
                for one in self._speaking.values():
                    one.go()
            case "rest":
                if self._proxy is not None:
                    self._proxy.spare()
                totals = await asyncio.gather(*(one.rest() for one in self._speaking.values()))
                return dict(zip(self._speaking, totals, strict=True))
            case "speak":
                for one in self._speaking.values():
                    await one.speak_once()
            case "settle":
                await self._node.graph()  # earlier messages on this connection have then arrived
                gc.collect()  # only objects that are still needed count
                _LIBC.malloc_trim(0)  # and not the allocator's free memory
            case "look":
                return self.look()
            case "make":
                return await self.make(msgspec.convert(value, Talker | Ear))
            case "end":
                return await self._end(value)
            case "cut" if self._proxy is not None:
                self._proxy.cut(*value)
            case "nap":
                print(f"{time.time():.3f} naps for {value:.2f} s")
                time.sleep(value)  # noqa: ASYNC251  a callback that blocks its loop
            case _:
                raise AssertionError(order)
        return None

    async def make(self, what: Talker | Ear) -> bool:
        """Make an endpoint; returns whether it exists: a limited process may not succeed."""
        print(f"makes {what}")
        try:
            if isinstance(what, Talker):
                publisher = await self._node.create_publisher(Parcel, what.topic, what.quality.profile())
                self._speaking[what.number] = Speaking(self, what, publisher)
                self._speaking[what.number].go()
            else:
                listening = Listening(self, what)
                await listening.open(self._node)
                self._listening[what.number] = listening
        except _STARVED as error:
            self.suffer(error)
            return False
        return True

    async def _end(self, number: int) -> int:
        """End an endpoint; returns how many messages it has published."""
        print(f"ends {number}")
        if number in self._listening:
            await self._listening.pop(number).close()
        elif number in self._speaking:
            speaking = self._speaking.pop(number)
            await speaking.close()
            return speaking.number
        return 0

    def look(self) -> Look:
        return Look(
            {number: one.number for number, one in self._speaking.items()},
            {number: one.look() for number, one in self._listening.items()},
            self._losses.count,
            self._proxy.cuts if self._proxy is not None else 0,
            dict(self._errors),
        )

    def suffer(self, error: BaseException) -> None:
        """Report an error as a fault, except in a limited process."""
        text = f"{type(error).__name__}: {error}"
        if not self.role.is_limited:
            self.complain(text)
        self._errors[type(error).__name__] += 1
        print("failed:", text[:300])

    def complain(self, text: str) -> None:
        with Path("faults").open("a") as faults:
            faults.write(f"{self.role.name}, {text}\n")

    def start(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        def look(task: asyncio.Task[None]) -> None:
            if not task.cancelled() and (error := task.exception()) is not None:
                self.suffer(error)

        task = asyncio.get_running_loop().create_task(work)
        task.add_done_callback(look)
        return task


class _Losses(logging.Handler):
    """Counts how often busd was lost."""

    count = 0

    def emit(self, record: logging.LogRecord) -> None:
        self.count += record.getMessage().startswith("lost busd")


async def _live(role: Role, channel: socket.socket, proxy: Proxy | None) -> None:
    reader, writer = await asyncio.open_connection(sock=channel)
    async with contextlib.AsyncExitStack() as stack:
        actor = Actor(role, await _enter_node(stack, role.name), proxy)
        for endpoint in role.endpoints:
            await actor.make(endpoint)
        _say(writer, "ready")
        while (line := await reader.readline()) and line != b'["leave",null]\n':
            _say(writer, await actor.do(*msgspec.json.decode(line)))
    writer.close()


async def _enter_node(stack: contextlib.AsyncExitStack, name: str) -> bus.Node:
    """Enter a node; if busd is away, try again."""
    while True:
        try:
            return await stack.enter_async_context(bus.Node(name, arguments=[], rosout=False))
        except bus.BrokerUnavailable as error:
            print("not yet:", error)
            await asyncio.sleep(0.05)


def _say(writer: asyncio.StreamWriter, what: object) -> None:
    writer.write(msgspec.json.encode(what) + b"\n")


def _proxy(name: str) -> Proxy:
    """Start the proxy to which the node connects in place of busd."""
    broker, path = Path(os.environ["BUSD_SOCKET"]), Path(f"{name}.sock").absolute()
    os.environ["BUSD_SOCKET"] = str(path)
    return Proxy(path, broker)


def _limit(role: Role) -> None:
    if role.cgroup:
        cgroup.enter(Path(role.cgroup))
    if role.files:
        used = max(int(entry.name) for entry in Path("/proc/self/fd").iterdir())
        _set_limit(resource.RLIMIT_NOFILE, used + 1 + role.files)
    if role.memory_bytes:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        _set_limit(resource.RLIMIT_AS, pages * resource.getpagesize() + role.memory_bytes)


def _set_limit(what: int, soft: int) -> None:
    resource.setrlimit(what, (soft, resource.getrlimit(what)[1]))


def _be(role: Role, channel: socket.socket) -> NoReturn:
    status = 1
    try:
        with Path(f"{role.name}.log").open("w", buffering=1) as log:
            os.dup2(log.fileno(), 1)
            os.dup2(log.fileno(), 2)
        sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
        if role.by_socket:
            os.environ["BUS_ROUTE"] = "socket"
        factory: Callable[[], asyncio.AbstractEventLoop] | None = (
            asyncio.new_event_loop if role.loop == "asyncio" else loop_factory()
        )
        _limit(role)
        with contextlib.ExitStack() as stack:
            proxy = stack.enter_context(_proxy(role.name)) if role.is_fragile else None
            runner = stack.enter_context(asyncio.Runner(loop_factory=factory))
            runner.run(_live(role, channel, proxy))
        status = 0
    except BaseException as error:
        sys.excepthook(*sys.exc_info())
        if not role.is_limited:
            with Path("faults").open("a") as faults:
                faults.write(f"{role.name}, {type(error).__name__}: {error}\n")
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


if __name__ == "__main__":
    type_support(Parcel)
    serve(int(sys.argv[1]), Role, lambda role, received: _be(role, socket.socket(fileno=received[0])))
