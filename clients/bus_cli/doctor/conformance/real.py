"""The stories with a real busd and a node of the library: samples before and after a kill of busd, and large
samples.

They show what the other stories can't: the route that busd chooses, also shared memory, and real matches.
"""

import asyncio
import socket
from collections.abc import Coroutine, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from time import monotonic
from types import TracebackType
from typing import Any, Self, TypeVar

import msgspec

from bus import names
from bus.errors import BusError
from bus.graph import Graph, GraphEndpoint
from bus.link.autostart import BUSD
from bus.node import Node
from bus.publisher import Publisher
from bus.qos import Durability, QoSProfile
from bus_cli.doctor.conformance import payloads
from bus_cli.doctor.conformance.client import Client
from bus_cli.doctor.conformance.conversation import LeftOut, Wrong, is_plain
from bus_cli.doctor.conformance.options import RELAY
from bus_cli.doctor.conformance.services import PLUMBING

__all__ = ["RealStage", "play", "play_growth"]

T = TypeVar("T")

_SAMPLES = 3
_GROWING_BYTES = 100, 10_000, 100_000, 1_000_000, 100
"""Each of the longer messages needs a larger ring than the one before."""
_SETTLED_S = 0.3
_TICK_S = 0.05


class RealStage:
    """A separate busd, the client and a node, while it is entered. Needs BUSD_AUTOSTART=0."""

    node: Node

    def __init__(self, command: Sequence[str], folder: Path, wait_s: float) -> None:
        self._path = folder / "busd.sock"
        self.client = Client(command, self._path)
        self.wait_s = wait_s

    async def __aenter__(self) -> Self:
        await self.start_busd()
        try:
            self.node = Node("conformance", arguments=(), socket=self._path, rosout=False)
            await self.node.open()
            try:
                await self.client.start()
            except BaseException:
                await self.node.close()
                raise
        except BaseException:
            await self.kill_busd()
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.client.stop()
        with suppress(BusError):
            await self.node.close()
        await self.kill_busd()

    async def start_busd(self) -> None:
        """Start busd, and wait until it listens."""
        log = (self._path.parent / "busd.log").open("ab")
        with log:
            words = (*BUSD, "--socket", str(self._path))
            self._busd = await asyncio.create_subprocess_exec(
                *words, stdin=asyncio.subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True
            )
        end = monotonic() + self.wait_s
        while not self._listens():
            if self._busd.returncode is not None or monotonic() > end:
                text = (self._path.parent / "busd.log").read_text(errors="replace").strip()
                raise Wrong(f"busd itself did not start: {text}")
            await asyncio.sleep(_TICK_S)

    async def kill_busd(self) -> None:
        with suppress(ProcessLookupError):
            self._busd.kill()
        await self._busd.wait()

    async def endpoints(self, what: str) -> list[GraphEndpoint]:
        """The client's endpoints on topics of users, once they are all there.

        Raises LeftOut if it has only services.
        """

        async def settled() -> list[GraphEndpoint]:
            found, since = list[GraphEndpoint](), monotonic()
            while not found or monotonic() - since < _SETTLED_S:
                now = _theirs(await self.node.graph())
                if {one.id for one in now} != {one.id for one in found}:
                    found, since = now, monotonic()
                await asyncio.sleep(_TICK_S)
            return found

        found = await self.within(settled(), what)
        plain = [one for one in found if is_plain(one.topic)]
        if not plain:
            raise LeftOut("it has only services")
        return plain

    async def within(self, coroutine: Coroutine[Any, Any, T], what: str) -> T:
        """The result; raises Wrong with `what` if it takes too long, or if the client ends before."""
        waiting = asyncio.ensure_future(coroutine)
        end = monotonic() + self.wait_s
        try:
            while not waiting.done():
                await asyncio.wait([waiting], timeout=_TICK_S)
                if waiting.done():
                    break
                if self.client.status is not None:
                    raise Wrong(f"{what}; {self.client.end_in_words()}{self._last_warning()}")
                if monotonic() > end:
                    raise Wrong(f"{what} within {self.wait_s:g} s{self._last_warning()}")
            return waiting.result()
        finally:
            waiting.cancel()

    def _last_warning(self) -> str:
        """The last warning in busd's log, which may name the client's mistake."""
        lines = (self._path.parent / "busd.log").read_text(errors="replace").splitlines()
        warnings = [line.partition("[busd]: ")[2] for line in lines if line.startswith("[WARN]")]
        return f"; busd: {warnings[-1]}" if warnings else ""

    def _listens(self) -> bool:
        with socket.socket(socket.AF_UNIX) as probe:
            try:
                probe.connect(str(self._path))
            except OSError:
                return False
        return True


async def play(stage: RealStage) -> str:
    """The story."""
    before = await stage.endpoints("it created no endpoint on a topic of its own")
    told = await _exchange(stage, before)
    await stage.kill_busd()
    await stage.start_busd()
    after = await stage.endpoints("it did not come back after a kill of busd")
    gone = {one.gid: one for one in before}.keys() - {one.gid for one in after}
    if gone:
        lost = ", ".join(one.topic for one in before if one.gid in gone)
        raise Wrong(f"after a kill of busd it did not declare again, with the same gid: {lost}")
    try:
        await _exchange(stage, after)
    except Wrong as error:
        raise Wrong(f"after a kill of busd: {error}") from None
    return f"{', '.join(told)}; the same after a kill of busd"


async def play_growth(stage: RealStage) -> str:
    """The story: messages that make the rings grow, on both sides if the client is a relay."""
    endpoints = await stage.endpoints("it created no endpoint on a topic of its own")
    told = []
    for one, target in _inputs(endpoints):
        schema = await stage.node.get_schema(one.type_name, one.type_hash)
        bodies = _known(payloads.make(schema, at, size) for at, size in enumerate(_GROWING_BYTES))
        if len(bodies) == len(_GROWING_BYTES):
            told.append(await _send(stage, one, target, bodies))
    if not told:
        raise LeftOut("it has no subscription to a type with a text")
    return f"{', '.join(told)}; texts of up to {max(_GROWING_BYTES)} bytes"


def _theirs(graph: Graph) -> list[GraphEndpoint]:
    """The client's endpoints on topics of users, and of services except for parameters."""
    found = (one for one in (*graph.publishers, *graph.subscriptions) if one.node.name != "conformance")
    return [one for one in found if is_plain(one.topic) or _is_of_service(one)]


def _is_of_service(one: GraphEndpoint) -> bool:
    return names.service_of_topic(one.topic) is not None and not one.type_name.startswith(PLUMBING)


async def _exchange(stage: RealStage, endpoints: list[GraphEndpoint]) -> list[str]:
    """Publish to its subscriptions and take samples from its publishers; returns a text about each."""
    inputs = _inputs(endpoints)
    told = []
    for one, target in inputs:
        schema = await stage.node.get_schema(one.type_name, one.type_hash)
        bodies = _known(payloads.make(schema, number) for number in range(1, _SAMPLES + 1))
        told.append(await _send(stage, one, target, bodies))
    relays = [target for _, target in inputs]
    outputs = [one for one in endpoints if one.kind == "publisher" and one not in relays]
    return told + [await _listen(stage, one) for one in outputs]


def _inputs(endpoints: list[GraphEndpoint]) -> list[tuple[GraphEndpoint, GraphEndpoint | None]]:
    """Its subscriptions, each with the publisher that publishes the same messages again, if one does."""
    outputs = (one for one in endpoints if (one.topic, one.kind) == (RELAY[1], "publisher"))
    target = next(outputs, None)
    found = [one for one in endpoints if one.kind == "subscription"]
    return [(one, target if one.topic == RELAY[0] else None) for one in found]


def _known(bodies: Iterable[bytes | None]) -> list[bytes]:
    return [body for body in bodies if body is not None]


async def _listen(stage: RealStage, one: GraphEndpoint) -> str:
    schema = await stage.node.get_schema(one.type_name, one.type_hash)
    subscription = await stage.node.create_subscription(None, one.topic, one.qos, raw=True)
    try:
        numbers = list[int]()
        while len(numbers) < _SAMPLES:
            what = f"{len(numbers)} of {_SAMPLES} samples came on {one.topic}"
            payload, info = await stage.within(subscription.receive(), what)
            if (fault := payloads.fault(schema, bytes(payload))) is not None:
                raise Wrong(f"a sample on {one.topic} is no {one.type_name}: {fault}")
            numbers.append(info.publication_sequence_number)
        if numbers != sorted(set(numbers)):
            raise Wrong(f"the numbers of the samples on {one.topic} do not grow: {numbers}")
        return f"{_SAMPLES} samples on {one.topic} by {await _route(stage, one)}"
    finally:
        await subscription.close()


async def _send(
    stage: RealStage, one: GraphEndpoint, target: GraphEndpoint | None, bodies: list[bytes]
) -> str:
    """Publish samples to its subscription `one`. If there is a `target`, it must return each."""
    schema = await stage.node.get_schema(one.type_name, one.type_hash)
    publisher = await stage.node.create_publisher(schema, one.topic, _offered(one.qos))
    try:
        await stage.within(
            publisher.wait_for_subscriptions(), f"its subscription on {one.topic} was not matched"
        )
        if target is not None:
            return await _return(stage, one, target, publisher, bodies)
        for body in bodies:
            publisher.publish_encoded(body)
        route = await _route(stage, one)
        await stage.within(asyncio.sleep(_SETTLED_S), f"it did not survive samples on {one.topic}")
        return f"{len(bodies)} samples for {one.topic} by {route}"
    finally:
        await publisher.close()


async def _return(
    stage: RealStage,
    one: GraphEndpoint,
    target: GraphEndpoint,
    publisher: Publisher[Any],
    bodies: list[bytes],
) -> str:
    subscription = await stage.node.create_subscription(None, target.topic, target.qos, raw=True)
    try:
        await stage.within(
            subscription.wait_for_publishers(), f"its publisher on {target.topic} was not matched"
        )
        routes = f"{await _route(stage, one)} and {await _route(stage, target)}"
        for number, body in enumerate(bodies, 1):
            publisher.publish_encoded(body)
            what = f"sample {number}, of {len(body)} bytes, did not come back by {routes}"
            payload, _ = await stage.within(subscription.receive(), what)
            if bytes(payload) != body:
                raise Wrong(f"sample {number} ({_shown(body)}) came back as {_shown(bytes(payload))}")
        routes = f"{await _route(stage, one)} and {await _route(stage, target)}"
        return f"{len(bodies)} samples returned by {routes}"
    finally:
        await subscription.close()


def _shown(body: bytes) -> str:
    """Its first bytes in hex, and its size if these are not all."""
    most = 40
    return body.hex(" ") if len(body) <= most else f"{body[:most].hex(' ')} ..., {len(body)} bytes"


def _offered(requested: QoSProfile) -> QoSProfile:
    """The offer for a subscription that takes any durability."""
    if requested.durability is not Durability.BEST_AVAILABLE:
        return requested
    return msgspec.structs.replace(requested, durability=Durability.VOLATILE)


async def _route(stage: RealStage, one: GraphEndpoint) -> str:
    graph = await stage.node.graph()
    routes = {match.route for match in graph.matches if one.id in (match.publisher, match.subscription)}
    return " and ".join(sorted(map(str, routes))) or "no route"
