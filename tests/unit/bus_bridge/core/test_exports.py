"""Messages taken by taps, and the publishers that taps hold back. Taps are lists here."""

import asyncio
from collections import deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from bus.msg.std_msgs import Int32
from bus.qos import QoSProfile
from bus.schema import schema_of
from bus.subscription import MessageInfo
from bus.types.support import type_support
from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.core import exports, pace
from bus_bridge.core.exports import Exports, TopicExports, TypedTopic
from bus_bridge.core.rules import Rules
from bus_bridge.engine import RouteRule
from semantics import until

LOSSLESS = QoSProfile(history="keep_all")
TOPIC, SCHEMA = TypedTopic("/numbers", "std_msgs/msg/Int32", "h"), schema_of(type_support(Int32))
STUCK, OTHER = b"s" * 16, b"o" * 16


class Tap:
    def __init__(self, qos: QoSProfile) -> None:
        self.qos = qos
        self.matches = [SimpleNamespace(gid=gid) for gid in (STUCK, OTHER)]
        self.waiting: deque[tuple[bytes, MessageInfo]] = deque()
        self.held: set[bytes] = set()

    def come(self, gid: bytes, *numbers: int) -> None:
        self.waiting += [(b"1234", MessageInfo(number, number, number, number, gid)) for number in numbers]

    def take_packed(self, most_bytes: int, longest: int) -> None:
        return None

    def take_many(self, limit: int) -> list[tuple[bytes, MessageInfo]]:
        taken = [one for one in self.waiting if one[1].publisher_gid not in self.held][:limit]
        for one in taken:
            self.waiting.remove(one)
        return taken

    def set_arrival_callback(self, callback: Callable[[], object]) -> None:
        self.arrive = callback

    def hold_back(self, gid: bytes) -> None:
        self.held.add(gid)

    def release(self, gid: bytes) -> None:
        self.held.discard(gid)


class Writer:
    is_wanted = True

    def __init__(self, room: int) -> None:
        self.room = room
        self.numbers: list[int] = []
        self.lost: dict[str, int] = {}

    def write(self, batch: Batch) -> int:
        sent = list(batch)[: self.room]
        self.room -= len(sent)
        self.numbers += [one.number for one in sent]
        return len(sent)

    def close(self) -> None: ...


class Stage:
    """The ways out of a stuck publisher and of another one, by taps of both kinds."""

    def __init__(self) -> None:
        self.unsure: set[Any] = set()
        self.route = TopicExports(
            TOPIC,
            SCHEMA,
            3,
            lambda gid: True,
            lambda gid: False,
            print,
            self.unsure,
            is_local=True,
        )
        self.writers = {STUCK: Writer(0), OTHER: Writer(100)}
        for gid, writer in self.writers.items():
            self.route.export(gid).attach(writer, LOSSLESS, RouteRule())
        self.open()

    def open(self) -> None:
        self.lossy, self.tap = taps = Tap(QoSProfile(5)), Tap(LOSSLESS)
        self.route.taps.replace([*taps])  # type: ignore[list-item]
        self.route.begin(is_back=False)

    def take(self) -> None:
        self.route.taps.take(self.tap)  # type: ignore[arg-type]


async def test_one_that_is_full_is_held_back_and_no_other() -> None:
    stage = Stage()
    stage.tap.come(STUCK, 1, 2)
    stage.take()
    assert stage.tap.held == set() and stage.unsure == set()
    stage.tap.come(STUCK, 3, 4)
    stage.tap.come(OTHER, 1)
    stage.take()
    assert stage.tap.held == {STUCK} and stage.lossy.held == set() and stage.unsure == {stage.route}
    stage.tap.come(STUCK, 5)
    stage.tap.come(OTHER, 2, 3)
    stage.take()
    assert stage.writers[OTHER].numbers == [1, 2, 3]
    assert stage.route.exports[STUCK].waiting == 4
    stage.writers[STUCK].room = 100
    stage.route.exports[STUCK].flush()
    assert stage.tap.held == set() and stage.route.taps.full == set()
    stage.take()
    assert stage.writers[STUCK].numbers == [1, 2, 3, 4, 5]


async def test_what_comes_without_a_pause_gathers_if_it_is_lossless(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pace, "_CLOSE_S", 60.0)  # works on any slow machine
    stage = Stage()
    for number in range(1, 31):
        stage.tap.come(OTHER, number)
        stage.tap.arrive()
    taken = len(stage.writers[OTHER].numbers)
    assert 0 < taken < 30
    await until(lambda: stage.writers[OTHER].numbers == [*range(1, 31)])
    for number in range(31, 61):
        stage.lossy.come(OTHER, number)
        stage.lossy.arrive()
    assert stage.writers[OTHER].numbers == [*range(1, 61)]


async def test_it_is_held_back_by_taps_that_are_made_anew() -> None:
    stage = Stage()
    stage.tap.come(STUCK, 1, 2, 3)
    stage.take()
    stage.open()
    assert stage.tap.held == {STUCK} and stage.lossy.held == set()


async def test_one_that_has_gone_is_held_back_no_more() -> None:
    stage = Stage()
    stage.tap.come(STUCK, 1, 2, 3)
    stage.take()
    stage.route.exports[STUCK].close()
    assert stage.tap.held == set() and stage.route.taps.full == set()


class Leaving:
    """A publisher that leaves while three of its messages wait."""

    def __init__(self) -> None:
        node: Any = None
        self.troubles: list[str] = []
        self.exports = Exports(node, Rules(), lambda gid: True, lambda gid: False, self.troubles.append)
        self.ends = 0
        self.show(Writer(0))
        self.export.put(Loose([Sample(b"1234", number, number) for number in range(1, 4)]))
        self.exports.withdraw(STUCK, self.end)

    def show(self, writer: Writer) -> None:
        shown: Any = SimpleNamespace(local=SimpleNamespace(gid=STUCK), rule=RouteRule())
        self.export, rule = self.exports.prepare(TOPIC, SCHEMA, shown)
        self.exports.attach(self.export, writer, LOSSLESS, rule)

    def end(self) -> None:
        self.ends += 1


async def test_what_waits_of_a_publisher_that_has_gone_is_lost_after_a_while(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(exports, "_LINGER_S", 0.05)
    leaving = Leaving()
    assert (leaving.ends, leaving.troubles) == (0, [])
    await until(lambda: leaving.ends)
    assert leaving.export.account.dropped == {"disconnected": 3}
    (said,) = leaving.troubles
    assert said.startswith("'/numbers': a publisher has left") and said.endswith("(messages lost: 3)")
    assert leaving.exports.schema(TOPIC) is None


async def test_what_waits_of_a_publisher_that_is_back_goes_on() -> None:
    leaving, writer = Leaving(), Writer(100)
    before = leaving.export
    leaving.show(writer)
    assert leaving.export is before and leaving.ends == 1
    assert writer.numbers == [1, 2, 3] and leaving.export.losses == {}
    leaving.exports.withdraw(STUCK, leaving.end)
    assert (leaving.ends, leaving.troubles) == (2, [])


async def test_a_tap_that_can_not_be_had_leaves_no_other_behind() -> None:
    made: list[Any] = []

    async def create_subscription(*arguments: object, **more: object) -> Any:
        if made:
            raise TimeoutError("busd does not answer")
        made.append(SimpleNamespace(matches=(), closed=asyncio.Event()))

        async def close() -> None:
            made[0].closed.set()

        made[0].close = close
        return made[0]

    node: Any = SimpleNamespace(create_subscription=create_subscription)
    ways = Exports(node, Rules(), lambda gid: True, lambda gid: False, print)
    with pytest.raises(TimeoutError):
        await ways.hold(TOPIC, SCHEMA, b"far")
    assert made[0].closed.is_set() and ways.schema(TOPIC) is None


async def test_a_tap_that_does_not_end_leaves_nothing_behind() -> None:
    node: Any = None
    ways = Exports(node, Rules(), lambda gid: True, lambda gid: False, print)
    route = ways.route(TOPIC, SCHEMA)
    tap: Any = SimpleNamespace(close=asyncio.Event().wait)
    route.taps.replace([tap])
    route.holders = 1
    releasing = asyncio.create_task(ways.release(route, b"far"))
    await asyncio.sleep(0)
    releasing.cancel()
    await asyncio.wait((releasing,))
    assert ways.schema(TOPIC) is None and not route.taps


async def test_a_dead_route_takes_no_later_one_of_its_topic_away() -> None:
    node: Any = None
    ways = Exports(node, Rules(), lambda gid: True, lambda gid: False, print)
    dead = ways.route(TOPIC, SCHEMA)
    ways._unsure.add(dead)
    ways._drop_unused(dead)
    assert ways.schema(TOPIC) is None
    later = ways.route(TOPIC, SCHEMA)
    assert later is not dead
    ways.sweep()
    assert ways.route(TOPIC, SCHEMA) is later and not ways._unsure
