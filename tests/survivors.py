"""Processes that tests kill and stop: talkers and listeners, forked from a process with all imports.

`nursery.py` starts this as a program and sends orders by its standard input. A talker notes its progress in a
file, and a listener its received numbers: a test can read them also for killed processes. Forbidden events go
to the file of faults.
"""

import asyncio
import ctypes
import errno
import fcntl
import mmap
import os
import random
import socket
import sys
import zlib
from collections import deque
from collections.abc import Callable, Coroutine
from typing import Any, Literal, NoReturn

import msgspec

import bus
from bus.base.descriptor import Descriptor
from bus.runner import loop_factory
from bus.shm import segments
from bus.types.support import type_support
from zygote import serve

TOPIC = "/parcels"
WORD_BYTES = 8
EARS = 4
"""The most subscriptions of a listener."""

NEWEST = 50
"""The number of recently received numbers kept for each."""

_BLOCK = random.Random(1).randbytes(1 << 20)
_F_ADD_SEALS = 1033
_F_SEAL_WRITE = 8


class Parcel(msgspec.Struct):
    """One message: a piece of random bytes with its checksum."""

    talker: int
    number: int
    is_certain: bool
    checksum: int
    body: bytes


class Talk(msgspec.Struct, tag="talk"):
    """A node with one publisher; its numbers begin at 1."""

    name: str
    talker: int
    seed: int
    ledger: str
    faults: str
    depth: int = 0  # 0 = keep all
    goal: int = 1 << 40
    burst: int = 10
    pause_s: float = 0.001
    size: int = 400
    growth: int = 0  # bytes that each message may be longer than the previous one, up to `size`; 0: at once
    notes: Literal["publish", "flush"] = "publish"  # the call after which messages are promised
    is_certain: bool = True  # nothing of it may be lost, except by the depth of the subscription
    loop: str = "uvloop"


class Ear(msgspec.Struct):
    """One subscription."""

    depth: int = 0  # 0 = keep all
    gaps: Literal["never", "before", "any"] = (
        "never"  # where numbers may be missing: before = before the first
    )
    takes: int = 1 << 40  # then it takes no more
    holds: int = 0  # how many messages it keeps; it checks each again at its release
    views: bool = False
    calls_back: bool = True


class Listen(msgspec.Struct, tag="listen"):
    """A node with subscriptions."""

    name: str
    ledger: str
    faults: str
    ears: list[Ear]
    keeps_rings: bool = False  # the descriptors of rings that it reads
    loop: str = "uvloop"


Role = Talk | Listen


class Ledger:
    """Numbers in a file, which outlive the writing process."""

    def __init__(self, path: str) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC)

    def note(self, place: int, number: int) -> None:
        os.pwrite(self._file, number.to_bytes(WORD_BYTES, "little"), place * WORD_BYTES)

    def close(self) -> None:
        os.close(self._file)


def qos(depth: int) -> bus.QoSProfile:
    return bus.QoSProfile(depth) if depth else bus.QoSProfile(history="keep_all")


def checksum(talker: int, number: int, body: bytes) -> int:
    return zlib.crc32(body, talker << 20 ^ number & 0xFFFFF)


# --- the roles


class Talker:
    """Publishes, in bursts, up to its goal, or until a request to stop."""

    def __init__(self, role: Talk) -> None:
        self.role = role
        self.number = 0
        self.goal = role.goal
        self._chance = random.Random(role.seed)
        self._ledger = Ledger(role.ledger)
        self._rests = asyncio.Event()

    async def open(self, node: bus.Node) -> None:
        self.publisher = await node.create_publisher(Parcel, TOPIC, qos(self.role.depth))
        self._task = start(self.role, self._talk())

    async def answer(self, question: str, value: Any) -> Any:
        assert question == "stop"
        self.goal = self.number
        await self._rests.wait()
        return self.number

    async def _talk(self) -> None:
        role, publisher = self.role, self.publisher
        while self.number < self.goal:
            for _ in range(min(role.burst, self.goal - self.number)):
                parcel = self._parcel(self.number + 1)
                if not publisher.publish(parcel):
                    self._ledger.note(1, parcel.number)
                    await publisher.send(parcel)
                self.number += 1
                if role.notes == "publish":
                    self._ledger.note(0, self.number)
            if role.notes == "flush":
                await publisher.flush()
                self._ledger.note(0, self.number)
            await asyncio.sleep(role.pause_s)
        self._rests.set()

    def _parcel(self, number: int) -> Parcel:
        role, chance = self.role, self._chance
        longest = min(role.size, role.growth * number) if role.growth else role.size
        size = chance.randrange(longest + 1)
        start = chance.randrange(len(_BLOCK) - size)
        body = _BLOCK[start : start + size]
        return Parcel(role.talker, number, role.is_certain, checksum(role.talker, number, body), body)


class Listener:
    """Checks every received message."""

    def __init__(self, role: Listen) -> None:
        self.role = role
        self._ledger = Ledger(role.ledger)
        self._subscriptions: list[bus.Subscription[Parcel]] = []
        self._newest: list[deque[int]] = [deque(maxlen=NEWEST) for _ in role.ears]
        self._tasks: list[asyncio.Task[None]] = []
        self._rings: list[Descriptor] = []

    async def open(self, node: bus.Node) -> None:
        if self.role.keeps_rings:
            self._keep_rings()
        for place, ear in enumerate(self.role.ears):
            hear = self._hearing(place, ear)
            callback = hear if ear.calls_back else None
            subscription = await node.create_subscription(
                Parcel, TOPIC, qos(ear.depth), callback, views=ear.views
            )
            self._subscriptions.append(subscription)
            if not ear.calls_back:
                self._tasks.append(start(self.role, self._iterate(subscription, ear, hear)))

    async def answer(self, question: str, value: Any) -> Any:
        match question:
            case "accounts":  # delivered, waiting and dropped, of each subscription
                found = [one.statistics() for one in self._subscriptions]
                return [(one.delivered, one.queued, sum(one.dropped.values())) for one in found]
            case "newest":  # numbers, of each subscription
                return [list(one) for one in self._newest]
            case "rings":
                return [_what_can_be_done_to(one.number) for one in self._rings]
            case _:
                raise AssertionError(question)

    def _keep_rings(self) -> None:
        map_ring = segments.map_ring

        def keep(descriptor: Descriptor) -> Any:
            self._rings.append(descriptor)
            return map_ring(descriptor)

        segments.map_ring = keep

    @staticmethod
    async def _iterate(
        subscription: bus.Subscription[Parcel], ear: Ear, hear: Callable[[Parcel], None]
    ) -> None:
        taken = 0
        async for parcel in subscription:
            hear(parcel)
            taken += 1
            if taken == ear.takes:
                await asyncio.Event().wait()

    def _hearing(self, place: int, ear: Ear) -> Callable[[Parcel], None]:
        last: dict[int, int] = {}
        held: deque[Parcel] = deque()
        newest = self._newest[place]
        note = self._ledger.note

        def hear(parcel: Parcel) -> None:
            talker, number = parcel.talker, parcel.number
            before = last.get(talker, 0)
            if _is_torn(parcel):
                complain(self.role, f"ear {place}: {talker}'s {number} is torn")
            if number <= before:
                complain(self.role, f"ear {place}: {talker}'s {number} after {before}")
            elif (
                number > before + 1
                and parcel.is_certain
                and (ear.gaps == "never" or (ear.gaps == "before" and before))
            ):
                complain(self.role, f"ear {place}: of {talker} {before + 1} to {number - 1} are missing")
            last[talker] = number
            newest.append(number)
            note(talker * EARS + place, number)
            held.append(parcel)
            if len(held) > ear.holds and _is_torn(old := held.popleft()):
                complain(self.role, f"ear {place}: {old.talker}'s {old.number} was changed")

        return hear


def _is_torn(parcel: Parcel) -> bool:
    return parcel.checksum != checksum(parcel.talker, parcel.number, parcel.body)


def start(role: Role, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
    """Begin the work of the role; a failure is reported as a fault."""

    def look(task: asyncio.Task[None]) -> None:
        if not task.cancelled() and (error := task.exception()) is not None:
            complain(role, repr(error))

    task = asyncio.create_task(work)
    task.add_done_callback(look)
    return task


def complain(role: Role, text: str) -> None:
    with open(role.faults, "a") as faults:  # noqa: PTH123
        faults.write(f"{role.name}, {text}\n")


# --- possible actions of a process on the rings that it reads


def _what_can_be_done_to(number: int) -> list[str]:
    """Attempts of a hostile reader: the names of those with success."""
    size = os.fstat(number).st_size

    def reopened() -> None:
        again = os.open(f"/proc/self/fd/{number}", os.O_RDWR)
        try:
            mmap.mmap(again, size, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE).close()
        finally:
            os.close(again)

    def protected() -> None:
        libc = ctypes.CDLL(None, use_errno=True)
        libc.mmap.restype = ctypes.c_void_p
        libc.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long]
        libc.mprotect.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
        libc.munmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t]
        place = libc.mmap(None, size, mmap.PROT_READ, mmap.MAP_SHARED, number, 0)
        failed = libc.mprotect(place, size, mmap.PROT_READ | mmap.PROT_WRITE)
        error = ctypes.get_errno()
        libc.munmap(place, size)
        if failed:
            raise OSError(error, os.strerror(error))

    attempts: dict[str, Callable[[], Any]] = {
        "map": lambda: mmap.mmap(number, size, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE).close(),
        "map for writing": lambda: mmap.mmap(number, size, mmap.MAP_SHARED, mmap.PROT_WRITE).close(),
        "reopen": reopened,
        "mprotect": protected,
        "write": lambda: os.pwrite(number, b"x", 0),
        "shrink": lambda: os.ftruncate(number, 0),
        "extend": lambda: os.ftruncate(number, 2 * size),
        "seal": lambda: fcntl.fcntl(number, _F_ADD_SEALS, _F_SEAL_WRITE),
    }
    worked = []
    for name, attempt in attempts.items():
        try:
            attempt()
        except OSError as error:
            assert error.errno in (errno.EPERM, errno.EACCES), (name, error)
        else:
            worked.append(name)
    return worked


# --- the process


async def _live(role: Role, channel: socket.socket) -> None:
    """Play `role`, and answer the test's questions, until the word "leave"."""
    actor = Talker(role) if isinstance(role, Talk) else Listener(role)
    reader, writer = await asyncio.open_connection(sock=channel)
    async with bus.Node(role.name, arguments=[], rosout=False) as node:
        await actor.open(node)
        _say(writer, "ready")
        while line := await reader.readline():
            question, value = msgspec.json.decode(line)
            match question:
                case "leave":
                    break
                case "graph":
                    _say(writer, await _graph(node))
                case _:
                    _say(writer, await actor.answer(question, value))
    writer.close()


def _say(writer: asyncio.StreamWriter, what: object) -> None:
    writer.write(msgspec.json.encode(what) + b"\n")


async def _graph(node: bus.Node) -> dict[str, list[str]]:
    graph = await node.graph()
    return {
        "nodes": sorted(one.name for one in graph.nodes),
        "endpoints": sorted(one.node.name for one in (*graph.publishers, *graph.subscriptions)),
        "routes": sorted({one.route for one in graph.matches}),
    }


def _be(role: Role, channel: socket.socket) -> NoReturn:
    status = 1
    try:
        factory = asyncio.new_event_loop if role.loop == "asyncio" else loop_factory()
        with asyncio.Runner(loop_factory=factory) as runner:
            runner.run(_live(role, channel))
        status = 0
    except BaseException as error:
        complain(role, f"{type(error).__name__}: {error}")
        sys.excepthook(*sys.exc_info())
    finally:
        sys.stderr.flush()
        os._exit(status)


if __name__ == "__main__":
    type_support(Parcel)
    line = os.dup(0)
    with open(os.devnull) as nothing:  # noqa: PTH123
        os.dup2(nothing.fileno(), 0)
    # A union is no type to mypy, but msgspec decodes into it.
    serve(line, Role, lambda role, received: _be(role, socket.socket(fileno=received[0])))  # type: ignore[arg-type]
