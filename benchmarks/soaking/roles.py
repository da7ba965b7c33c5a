"""The processes of a soak: talkers, listeners, visitors, each on the bus that the environment names.

    python -m benchmarks.soaking.roles <Part as JSON>

They use the protocol of benchmarks.harness: `ready`, and the words `go`, `report` and `stop`. The answer to
`report` is `interval`, with the events since the last one. The answer to `stop` is `stopped`. A talker's
totals are by topic. A listener's totals are by subscription, with its queued messages. `faults` has texts
about errors that must never happen.
"""

import asyncio
import gc
from collections.abc import Iterator
from time import monotonic_ns
from typing import Any, NamedTuple

import bus
from benchmarks.soaking.histogram import Histogram
from benchmarks.soaking.ledger import Ledger, Visit
from benchmarks.soaking.load import (
    LATCHED,
    LISTENERS,
    NAP_DEPTH,
    NAP_S,
    STREAMS,
    TALKERS,
    VISIT_S,
    Part,
    Stream,
    route_of,
    text,
)
from benchmarks.worker import Parent, options, run
from bus import shm
from bus.msg.std_msgs import String

LIFE_S = 48 * 3600
"""No process of a soak lives longer."""
_VISIT_LIMIT_S = 60.0


def _qos(stream: Stream) -> bus.QoSProfile:
    if stream.kind == "lossless":
        return bus.QoSProfile(history="keep_all")
    if stream.kind == "lossy":
        return bus.QoSProfile(depth=stream.depth, reliability="best_effort")
    return bus.QoSProfile(depth=stream.depth, durability="transient_local")


async def _obey(parent: Parent, report: Any) -> None:
    """Answer the word `report` until another word comes, which must be `stop`."""
    while True:
        word = await parent.next_word()
        if word == "stop":
            return
        if word != "report":
            raise ValueError(f"the word {word!r} came, and not report or stop")
        parent.tell("interval", **report())


# --- talkers


class _Speech:
    """One stream of one talker, by a fixed schedule: late messages are sent at once."""

    def __init__(self, talker: str, stream: Stream, pub: bus.Publisher[String]) -> None:
        self.pub = pub
        self.stream = stream
        self._talker = talker

    async def talk(self) -> None:
        period_ns = int(1e9 / self.stream.rate)
        due_ns, number = monotonic_ns(), 0
        while True:
            due_ns += period_ns
            # Sleep even if late: the loop needs its turns.
            await asyncio.sleep(max(0, due_ns - monotonic_ns()) / 1e9)
            number += 1
            message = String(data=text(self._talker, number, monotonic_ns(), self.stream.size))
            if not self.pub.publish(message):
                await self.pub.send(message)


async def talker(parent: Parent, name: str) -> None:
    async with bus.Node(name) as node:
        speeches = []
        for stream in STREAMS:
            pub = await node.create_publisher(String, stream.topic, _qos(stream))
            speeches.append(_Speech(name, stream, pub))
        for speech in speeches:
            await speech.pub.wait_for_subscriptions(_hearers(speech.stream))
        parent.tell("ready", routes=[match.route for speech in speeches for match in speech.pub.matches])
        await parent.wait_for("go")
        tasks = [asyncio.create_task(speech.talk()) for speech in speeches]
        obeying = asyncio.create_task(_obey(parent, lambda: _published(speeches)))
        try:
            await _first_of(obeying, *tasks)
        finally:
            for task in (obeying, *tasks):
                task.cancel()
            await asyncio.gather(obeying, *tasks, return_exceptions=True)
        for speech in speeches:
            await speech.pub.flush()
        parent.tell("stopped", **_published(speeches))
        await asyncio.Event().wait()


def _published(speeches: list[_Speech]) -> dict[str, Any]:
    return {"published": {one.stream.topic: one.pub.statistics().published for one in speeches}}


def _hearers(stream: Stream) -> int:
    """The number of permanent subscriptions of a stream."""
    if stream.kind == "latched":
        return 0  # visitors come at any time
    return len(LISTENERS) * (2 if stream.kind == "lossy" else 1)


# --- listeners


class _Ear(NamedTuple):
    sub: bus.Subscription[String]
    stream: Stream
    ledger: Ledger
    is_sleepy: bool

    @property
    def name(self) -> str:
        return self.stream.topic + (", sleepy" if self.is_sleepy else "")

    def totals(self) -> dict[str, Any]:
        found = self.sub.statistics()
        return {
            "topic": self.stream.topic,
            "kind": self.stream.kind,
            "delivered": found.delivered,
            "queued": found.queued,
            "dropped": found.dropped,
        }

    def take_all(self) -> None:
        while taken := self.sub.take():
            self.ledger.note(taken[0].data, monotonic_ns())


async def listener(parent: Parent, name: str) -> None:
    faults: list[str] = []
    async with bus.Node(name) as node:
        ears = [await _listen(node, stream, faults) for stream in STREAMS if stream.kind != "latched"]
        ears += [await _nod(node, stream, faults) for stream in STREAMS if stream.kind == "lossy"]
        sleepy = [ear for ear in ears if ear.is_sleepy]

        def report() -> dict[str, Any]:
            for ear in sleepy:
                ear.take_all()
            found, faults[:] = list(faults), []
            totals = {ear.name: ear.totals() for ear in ears}
            return {"ages": dict(_ages(ears, name)), "totals": totals, "faults": found}

        async def wake() -> None:
            while True:
                await asyncio.sleep(NAP_S)
                for ear in sleepy:
                    ear.take_all()

        parent.tell("ready")
        await parent.wait_for("go")
        await _first_of(asyncio.create_task(_obey(parent, report)), asyncio.create_task(wake()))


async def _listen(node: bus.Node, stream: Stream, faults: list[str]) -> _Ear:
    ledger = Ledger(stream, faults.append)
    sub = await node.create_subscription(
        String, stream.topic, _qos(stream), lambda message: ledger.note(message.data, monotonic_ns())
    )
    return _Ear(sub, stream, ledger, is_sleepy=False)


async def _nod(node: bus.Node, stream: Stream, faults: list[str]) -> _Ear:
    """A subscription that loses much: it keeps few messages and takes them rarely."""
    qos = bus.QoSProfile(depth=NAP_DEPTH, reliability="best_effort")
    sub = await node.create_subscription(String, stream.topic, qos)
    return _Ear(sub, stream, Ledger(stream, faults.append), is_sleepy=True)


def _ages(ears: list[_Ear], name: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Ages by route and size. Leaves out sleepy subscriptions: their ages only show the length of their
    naps."""
    found: dict[str, Histogram] = {}
    for ear in ears:
        for talker_name, ages in ear.ledger.take_ages().items():
            if not ear.is_sleepy:
                route = route_of(talker_name, name) if shm.is_available() else "socket"
                group = f"{route} {ear.stream.size}"
                found.setdefault(group, Histogram()).merge(ages)
    for group, ages in found.items():
        yield group, {"counts": ages.counts, "max_ns": ages.max_ns}


# --- visitors


class _Guest:
    """Comes and goes; each visit makes a connection, a node and a subscription."""

    def __init__(self, name: str) -> None:
        self.visits = self.heard = 0
        self.faults: list[str] = []
        self._name = name

    async def come_and_go(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            next_s = loop.time() + VISIT_S
            await self._visit()
            await asyncio.sleep(max(0.0, next_s - loop.time()))

    async def _visit(self) -> None:
        visit, over = Visit(LATCHED, len(TALKERS)), asyncio.Event()

        def hear(message: String) -> None:
            visit.note(message.data)
            if visit.is_over:
                over.set()

        async with bus.Node(self._name) as node:
            qos = bus.QoSProfile(depth=10 * LATCHED.depth, durability="transient_local")
            await node.create_subscription(String, LATCHED.topic, qos, hear)
            visit.created(monotonic_ns())
            async with asyncio.timeout(_VISIT_LIMIT_S):
                await over.wait()
        self.visits += 1
        self.heard += visit.count
        self.faults += visit.verdict()

    def report(self) -> dict[str, Any]:
        # The segment of a closed connection stays mapped until Python's collector runs. This is not a leak.
        gc.collect()
        found, self.faults = self.faults, []
        return {"visits": self.visits, "heard": self.heard, "faults": found}


async def visitor(parent: Parent, name: str) -> None:
    guest = _Guest(name)
    parent.tell("ready")
    await parent.wait_for("go")
    visits = asyncio.create_task(guest.come_and_go())
    try:
        await _first_of(asyncio.create_task(_obey(parent, guest.report)), visits)
    finally:
        visits.cancel()
        await asyncio.gather(visits, return_exceptions=True)
    parent.tell("stopped", **guest.report())
    await asyncio.Event().wait()


async def _first_of(*tasks: "asyncio.Task[None]") -> None:
    """Wait until one task has ended; raises its exception."""
    done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    for task in done:
        task.result()


def main() -> None:
    part: Part = options(Part)
    role = {"talker": talker, "listener": listener, "visitor": visitor}[part.name.split("_")[1]]
    run(lambda parent: role(parent, part.name), life_s=LIFE_S)


if __name__ == "__main__":
    main()
