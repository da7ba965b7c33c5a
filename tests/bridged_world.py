"""Buses on separate machines, joined by bridges: processes, messages that cross, and forbidden events.

    with World(folder, forks, "robot", "laptop") as world:
        world.join_by_zenoh("robot", "laptop")
        async with world["robot"].node("talker") as talker, world["laptop"].node("listener") as listener:
            async with Stream.open("/chatter", talker, listener) as stream:
                await stream.flows()

Each machine is a network namespace if that is possible, otherwise loopback. Only bridges and peers run in it:
busd and programs of a bus communicate by files. Tests wait for events; times are only bounds of waits.
"""

import asyncio
import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterator
from contextlib import ExitStack, asynccontextmanager
from functools import wraps
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, ParamSpec, Self

import pytest

import bus
import cli
import netns
from bus.graph import Graph
from bus.msg.std_msgs import String
from bus.node import Node
from bus.runner import loop_factory
from bus_cli.query import Query
from conftest import TEST_S, WAIT_S, Daemon
from forks import Fork, Forks
from machine_programs import begin_on
from netns import Cable, Machine, Machines
from ports import free_port, own_domain

P = ParamSpec("P")
Engine = Literal["zenoh", "ros2"]

_PORT = 7447
_SPARED = 4
"""The pause between two looks at a condition, in times that a look took."""
_DOMAIN = own_domain()


def on_one_loop(test: Callable[P, Coroutine[Any, Any, None]]) -> Callable[P, None]:
    """Mark a test that takes seconds, because processes are killed and return: it runs on one loop."""

    @wraps(test)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        with asyncio.Runner(loop_factory=loop_factory()) as runner:
            runner.run(_bounded(test(*args, **kwargs)))

    return run


async def _bounded(work: Awaitable[None]) -> None:
    async with asyncio.timeout(TEST_S):
        await work


async def until(
    condition: Callable[[], Any], what: str | Callable[[], str] = "", within_s: float = WAIT_S
) -> float:
    """Wait for the condition; returns how long it took, in seconds. Raises AssertionError."""
    began = looked = time.monotonic()
    while not condition():
        now = time.monotonic()
        if now - began > within_s:
            raise AssertionError(f"not within {within_s:g} s: {what() if callable(what) else what}")
        await asyncio.sleep(max(0.005, _SPARED * (now - looked)))  # the others need the processors
        looked = time.monotonic()
    return time.monotonic() - began


class Bridge:
    """A `bus bridge` with its log in a file."""

    def __init__(self, side: "Side", engine: Engine, arguments: tuple[str, ...]) -> None:
        self.side = side
        self.engine = engine
        self.arguments = arguments
        self.log = side.path.with_name(f"{side.name}{self.node.replace('/bridge', '')}.log")
        self.is_killed = False
        self.process = self._start()

    def _start(self) -> subprocess.Popen[bytes] | Fork:
        self.is_killed = False
        words = ("bridge", self.engine, *self.arguments, "--socket", str(self.side.path))
        environment = {**os.environ, "BUSD_AUTOSTART": "0"}
        with self.log.open("ab") as log:
            self._silent_bytes = log.tell()
            return begin_on(self.side.machine, "bus_cli", *words, output=log, environment=environment)

    @property
    def node(self) -> str:
        """The full name of its node."""
        words = self.arguments
        domain = words[words.index("--domain-id") + 1] if "--domain-id" in words else "0"
        name = "/bridge_rmw_zenoh" if "--rmw" in words else f"/bridge_{self.engine}"
        return name if domain == "0" else f"{name}_{domain}"

    def restart(self) -> None:
        """Start it again after its end."""
        self.process = self._start()

    def kill(self) -> None:
        """kill -9"""
        self.is_killed = True
        self.process.kill()
        self.process.wait(WAIT_S)

    @contextlib.contextmanager
    def stopped(self) -> Iterator[None]:
        """Stop the process during the block: it hangs."""
        self.process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self.process.send_signal(signal.SIGCONT)

    def end(self) -> None:
        """End it by Ctrl-C."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait(WAIT_S / 2)

    def close(self) -> str:
        """End it in any state; returns its log."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self._wait_for_first_line()
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(WAIT_S / 2)
            except subprocess.TimeoutExpired:
                self.kill()
                return f"it did not end after Ctrl-C\n{self.log.read_text()}"
        return self.log.read_text()

    def _wait_for_first_line(self) -> None:
        """Wait until it logs, or ends: a Ctrl-C while Python starts prints a traceback of Python's own."""
        end = time.monotonic() + WAIT_S / 2
        while self.log.stat().st_size <= self._silent_bytes and self.process.poll() is None:
            if time.monotonic() > end:
                return
            time.sleep(0.005)

    def status(self) -> dict[str, Any]:
        """Its status from `bus bridge status --json`. Raises AssertionError if there is none."""
        found = self.side.bus("bridge", "status", "--json")
        for line in found.out.splitlines():
            answer: dict[str, Any] = json.loads(line)
            if answer["node"] == self.node:
                return answer
        raise AssertionError(f"no status: {found}; log: {self.log.read_text()[-2000:]}")

    def route(self, topic: str, direction: Literal["in", "out"]) -> dict[str, Any]:
        """The counters of the only route of a topic in this direction."""
        routes: list[dict[str, Any]] = self.status()["routes"]
        (found,) = [one for one in routes if one["topic"] == topic and one["direction"] == direction]
        return found


class Side:
    """A bus, and the machine on which its bridges run."""

    def __init__(self, name: str, daemon: Daemon, machine: Machine | None) -> None:
        self.name = name
        self.daemon = daemon
        self.path = daemon.path
        self.machine = machine
        self.bridges: list[Bridge] = []

    def bus(self, *words: str) -> cli.Result:
        """Run `bus` on it, to its end."""
        return cli.bus(*words, "--socket", str(self.path))

    def start(self, *words: str) -> cli.Running:
        """Start a `bus` that keeps running."""
        return cli.start(*words, "--socket", str(self.path))

    def node(self, name: str, *, namespace: str = "") -> Node:
        """A node in this process."""
        return Node(name, namespace=namespace, socket=self.path, arguments=[], rosout=False)

    def bridge(self, engine: Engine, *arguments: str) -> Bridge:
        """Start a bridge."""
        self.bridges.append(Bridge(self, engine, arguments))
        return self.bridges[-1]

    def graph(self) -> Graph:
        """The graph, with counters."""
        with Query(self.path, may_start=False) as query:
            return query.graph(statistics=True)

    def names(self) -> set[str]:
        """The full names of its nodes."""
        return {node.full_name for node in self.graph().nodes}

    async def shows(self, fits: Callable[[Graph], Any], within_s: float = WAIT_S) -> Graph:
        """The first graph that fits."""
        found = [self.graph()]

        def has_come() -> Any:
            for bridge in self.bridges:
                assert bridge.is_killed or bridge.process.poll() is None, bridge.log.read_text()[-2000:]
            found[0] = self.graph()
            return fits(found[0])

        await until(has_come, lambda: f"the graph of {self.name}: {found[0]}", within_s)
        return found[0]


class World:
    """Some buses. Leaving ends all processes, and checks each log for a traceback."""

    def __init__(self, folder: Path, forks: Forks | None, *names: str) -> None:
        self.carrier = "auto"
        """The carrier of topics of bridges to ROS 2, for tests that know it."""
        self._folder = folder
        self._forks = forks
        self._names = names or ("robot", "laptop")
        self._sides: dict[str, Side] = {}
        self._cables: dict[frozenset[str], Cable] = {}
        self._machines: Machines | None = None
        self._stack = ExitStack()

    def __getitem__(self, name: str) -> Side:
        return self._sides[name]

    @property
    def sides(self) -> list[Side]:
        return [*self._sides.values()]

    @property
    def bridges(self) -> list[Bridge]:
        return [bridge for side in self.sides for bridge in side.bridges]

    @property
    def domain(self) -> int:
        """A domain of ROS 2 that no other test on this machine uses."""
        return 0 if self._machines else _DOMAIN

    def cable(self, *names: str) -> Cable:
        """The cable between two machines. Skips the test if there is none."""
        if not self._cables:
            pytest.skip(netns.why_not())
        return self._cables[frozenset(names or self._names[:2])]

    def join_by_zenoh(
        self,
        listener: str = "",
        other: str = "",
        *,
        listening: tuple[str, ...] = (),
        connecting: tuple[str, ...] = (),
    ) -> tuple[Bridge, Bridge]:
        """Start two bridges; the second connects to the first, with these additional options."""
        listener, other = listener or self._names[0], other or self._names[1]
        endpoint = self.lay(listener, other)
        return (
            self[listener].bridge("zenoh", "--listen", endpoint, "--insecure", *listening),
            self[other].bridge("zenoh", "--connect", endpoint, "--insecure", *connecting),
        )

    def lay(self, one: str, other: str) -> str:
        """Lay a cable between two machines; returns zenoh's address of the first for the second."""
        if self._machines is None:
            return f"tcp/127.0.0.1:{free_port()}"
        cable = self._cables[frozenset((one, other))] = self._machines.connect(one, other)
        return f"tcp/{cable.address_of(one)}:{_PORT}"

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            if not netns.why_not():
                self._machines = stack.enter_context(Machines(*self._names))
            for name in self._names:
                daemon = Daemon(self._folder / f"{name}.sock", forks=self._forks)
                machine = self._machines[name] if self._machines else None
                self._sides[name] = Side(name, daemon, machine)
                stack.callback(daemon.stop)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._stack:
            logs = {bridge.log.stem: bridge.close() for bridge in self.bridges}
            logs |= {f"busd of {side.name}": side.daemon.stop() for side in self.sides}
        bad = {name: log for name, log in logs.items() if "Traceback" in log or "did not end" in log}
        if error is not None:
            for name, log in logs.items():
                sys.stderr.write(f"--- {name}\n{log[-3000:]}\n")
        else:
            assert not bad, "\n".join(f"--- {name}\n{log[-3000:]}" for name, log in bad.items())


class Stream:
    """Numbers from a publisher to a subscription on another bus, and the received ones."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.sent = 0
        self.heard: list[int] = []
        self.infos: list[bus.MessageInfo] = []
        self.publisher: bus.Publisher[String]
        self.subscription: bus.Subscription[String]
        self._talk: asyncio.Task[None] | None = None

    @classmethod
    @asynccontextmanager
    async def open(
        cls,
        topic: str,
        talker: bus.Node,
        listener: bus.Node,
        qos: bus.QoSProfile | int = 1000,
        hz: float = 100.0,
    ) -> "AsyncIterator[Stream]":
        """Publish until the end of the block. `hz` 0: only by `say`."""
        stream = cls(topic)
        stream.subscription = await listener.create_subscription(String, topic, qos, stream.hear)
        stream.publisher = await talker.create_publisher(String, topic, qos)
        if hz:
            stream._talk = asyncio.create_task(stream._say(hz))
        try:
            yield stream
        finally:
            await stream.stop()

    def hear(self, message: String, info: bus.MessageInfo) -> None:
        self.heard.append(int(message.data))
        self.infos.append(info)

    def say(self) -> None:
        """Publish one more number."""
        self.sent += 1
        self.publisher.publish(String(data=str(self.sent)))

    async def _say(self, hz: float) -> None:
        await self.publisher.wait_for_subscriptions()
        while True:
            self.say()
            await asyncio.sleep(1 / hz)

    async def stop(self) -> None:
        """Stop publishing."""
        if self._talk is not None:
            self._talk.cancel()
            await asyncio.gather(self._talk, return_exceptions=True)
            self._talk = None

    async def flows(self, within_s: float = WAIT_S) -> float:
        """Wait until a number published from now on is received; returns how long it took, in seconds."""
        now = self.sent
        return await until(
            lambda: self.heard and self.heard[-1] > now,
            lambda: f"{self.topic} flows: said {now}, then {self.sent}, heard {self.heard[-1:]}",
            within_s,
        )

    async def arrived(self) -> None:
        """Wait until the last published number, or a later one, has been received."""
        await until(lambda: self.heard and self.heard[-1] >= self.sent, f"{self.topic}: {self.sent}")

    def check(self) -> int:
        """Check that nothing came twice or out of order; returns how many are missing in between."""
        assert all(one < next_one for one, next_one in pairwise(self.heard)), _disorder(self.heard)
        return self.heard[-1] - self.heard[0] + 1 - len(self.heard) if self.heard else 0


def _disorder(numbers: list[int]) -> str:
    at = next(place for place, (one, other) in enumerate(pairwise(numbers)) if one >= other)
    return f"after {numbers[max(0, at - 3) : at + 1]} came {numbers[at + 1 : at + 4]}"
