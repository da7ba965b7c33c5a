"""The way out of a publisher: every cell of its table, and the times of its writes."""

import asyncio
from collections.abc import Callable
from itertools import product
from typing import Any

import pytest

from bus.msg.std_msgs import String
from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus.vocabulary import DropReason
from bus_bridge.batch import Loose, Sample
from bus_bridge.engine import LocalEndpoint, LocalNode, RouteRule
from bus_bridge.packed import Packed
from bus_bridge.zenoh import probing, writing
from bus_bridge.zenoh.presence import Interest
from bus_bridge.zenoh.records import Part, Probe, read_part, write_pair
from bus_bridge.zenoh.writing import TRANSITIONS, WriterError, ZenohWriter
from bus_bridge.zenoh.writing import WriterEvent as Event
from bus_bridge.zenoh.writing import WriterState as State
from semantics import until
from transitions import paths

RUN = "run"
HERE = frozenset((Interest("far", RUN),))
LOSSLESS = QoSProfile(history="keep_all")
BEST_EFFORT = QoSProfile(10, reliability="best_effort")


class Outlet:
    def __init__(self, puts: list[Part]) -> None:
        self.puts = puts
        self.put: Any = self._put
        self.is_gone = False

    def _put(self, payload: bytes, attachment: bytes) -> None:
        found = read_part(payload, attachment)
        assert found is not None
        self.puts.append(Part(payload, found[0], attachment))

    def undeclare(self) -> None:
        self.is_gone = True


class Query:
    """A question of an importer."""

    def __init__(self, payload: bytes) -> None:
        self.payload = payload
        self.answered, self.head = b"", b""
        self.is_dropped = False

    def reply(self, payload: bytes, head: bytes) -> None:
        self.answered, self.head = payload, head

    def drop(self) -> None:
        self.is_dropped = True


class Session:
    """A session whose outlets can be used at once."""

    def __init__(self) -> None:
        self.puts: list[Part] = []
        self.outlets: list[Outlet] = []
        self.priorities: list[str] = []

    def outlet(self, key: str, priority: str, on_ready: Callable[[], None]) -> Outlet:
        self.priorities.append(priority)
        self.outlets.append(Outlet(self.puts))
        return self.outlets[-1]


class Scene:
    """A way out that has reached `state`."""

    def __init__(self, qos: QoSProfile | None = None, state: State = State.OPEN) -> None:
        self.session = Session()
        self.changes = self.closes = 0
        schema = MessageSchema.of(String)
        self.endpoint = LocalEndpoint(
            "publisher",
            bytes(16),
            LocalNode(1, "talker", "/"),
            "/t",
            schema.type_name,
            schema.type_hash,
            qos or QoSProfile(10),
        )
        session: Any = self.session
        self.writer = ZenohWriter(session, "here", self.endpoint, RouteRule(), self._change, self._close)
        self.writer.see_interests(HERE)
        for event in paths(TRANSITIONS, State.OPEN)[state]:
            self.do(event)
        assert self.writer.state is state

    def _change(self) -> None:
        self.changes += 1

    def _close(self) -> None:
        self.closes += 1

    def do(self, event: Event) -> None:
        match event:
            case Event.LEAVE:
                if not self.writer._number:
                    self.write(b"x")
                self.writer.close()
            case Event.RETURN:
                assert self.writer.come_back(self.endpoint, RouteRule(), self._change)
            case Event.END:
                self.writer.end()

    def write(self, *payloads: bytes) -> int:
        return self.writer.write(Loose([Sample(one, at, at) for at, one in enumerate(payloads, 1)]))

    def kept(self, after: int, importer: str = RUN) -> list[int]:
        """Numbers of the kept messages in the answer to an importer."""
        query = Query(b"h" + write_pair(after, 0))
        self.writer.reply(query, importer)  # type: ignore[arg-type]
        found = read_part(query.answered, query.head[16:]) if query.head[16:] else None
        return [one.number for one in found[1]] if found is not None and isinstance(found[1], Packed) else []

    def fill(self) -> None:
        """Write until there is no room."""
        while self.write(bytes(10_000)):
            pass

    @property
    def parts(self) -> list[int]:
        """Numbers of the parts with messages."""
        return [one.number for one in self.session.puts if not self._is_probe(one)]

    @property
    def probes(self) -> int:
        return sum(map(self._is_probe, self.session.puts))

    def _is_probe(self, part: Part) -> bool:
        found = read_part(part.payload, part.head)
        return found is not None and isinstance(found[1], Probe)


@pytest.mark.parametrize(("state", "event"), [*product(State, Event)])
async def test_every_cell(state: State, event: Event) -> None:
    scene, following = Scene(state=state), TRANSITIONS[state].get(event)
    if following is None:
        with pytest.raises(WriterError) as caught:
            scene.writer.on(event)
        assert str(caught.value) == (
            f"the way out of a publisher on '/t' is {state.value!r}: {event.value!r} can't happen to it"
        )
        following = state
    else:
        scene.do(event)
    assert scene.writer.state is following
    is_closed = following is State.CLOSED
    assert scene.session.outlets[0].is_gone is is_closed and scene.closes == is_closed
    assert scene.writer._leave.behind == (set() if following is State.OPEN else {RUN}) or is_closed
    scene.writer.end()


def test_every_state_has_a_row_and_can_be_reached() -> None:
    assert {*paths(TRANSITIONS, State.OPEN)} == {*State} == {*TRANSITIONS}


async def test_one_that_is_closed_twice_leaves_and_ends_once() -> None:
    scene = Scene(state=State.LEAVING)
    scene.writer.close()
    assert scene.closes == 0
    scene.writer.end()
    scene.writer.end()
    scene.writer.close()
    assert scene.closes == 1


async def test_one_that_has_written_nothing_or_has_no_importers_ends_at_once() -> None:
    idle, alone = Scene(), Scene()
    idle.writer.close()
    alone.writer.see_interests(frozenset())
    assert alone.write(b"x") == 1
    alone.writer.close()
    assert (idle.closes, alone.closes) == (1, 1)


async def test_one_that_leaves_ends_when_all_has_arrived() -> None:
    scene = Scene(state=State.LEAVING)
    assert scene.parts == [1] and scene.probes == 1
    scene.writer.see_ack(RUN, 0, 0)
    assert scene.probes == 2  # some messages have not arrived
    scene.writer.see_ack(RUN, 1, 0)
    assert scene.closes == 1


async def test_one_that_leaves_waits_for_no_importer_that_goes_or_stands_still(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = Scene(state=State.LEAVING)
    scene.writer.see_interests(frozenset())
    assert scene.closes == 1
    monkeypatch.setattr(writing, "_LEAVE_S", 0.01)
    scene = Scene(state=State.LEAVING)
    await until(lambda: scene.closes)


async def test_a_publisher_that_returns_goes_on_and_begins_its_losses_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(writing, "_LEAVE_S", 0.01)
    scene = Scene(BEST_EFFORT)
    while not scene.writer.lost:
        assert scene.write(bytes(10_000)) == 1
    lost = scene.writer.lost
    assert lost == {DropReason.LINK_FULL: 1}
    written = scene.parts[-1]
    scene.writer.close()
    assert scene.writer.come_back(scene.endpoint, RouteRule(), scene._change)
    assert scene.writer.lost == {} and lost == {DropReason.LINK_FULL: 1}  # the caller has counted these
    await asyncio.sleep(0.03)
    assert scene.closes == 0
    scene.writer.see_ack(RUN, written, written)
    scene.write(b"more")
    assert scene.parts[-1] == written + 1


async def test_a_publisher_that_returns_gets_the_priority_of_a_new_rule() -> None:
    scene = Scene(state=State.LEAVING)
    assert scene.writer.come_back(scene.endpoint, RouteRule(priority="real_time", depth=3), scene._change)
    assert scene.session.priorities == ["data", "real_time"]
    assert [one.is_gone for one in scene.session.outlets] == [True, False]
    scene.write(b"more")
    assert scene.parts == [1, 2]  # importers go on
    scene.writer.close()
    assert scene.writer.come_back(scene.endpoint, RouteRule(priority="real_time"), scene._change)
    assert len(scene.session.outlets) == 2
    scene.writer.end()


async def test_a_publisher_that_returns_gets_the_depth_of_a_new_rule() -> None:
    scene = Scene(QoSProfile(history="keep_all", durability="transient_local"))
    scene.write(*[b"x"] * 5)

    def kept() -> int:
        assert scene.writer._history is not None
        part = scene.writer._history.find(0, 0, 5)
        found = None if part is None else read_part(part.payload, part.head)
        assert found is not None and isinstance(found[1], Packed)
        return found[1].count

    assert kept() == 5
    for depth, count in ((3, 3), (None, 3)):
        scene.writer.close()
        assert scene.writer.come_back(scene.endpoint, RouteRule(depth=depth), scene._change)
        assert kept() == count
    scene.writer.end()


async def test_another_publisher_of_the_same_gid_is_no_return() -> None:
    scene, other = Scene(state=State.LEAVING), Scene(BEST_EFFORT)
    assert not scene.writer.come_back(other.endpoint, RouteRule(), scene._change)
    assert scene.writer.state is State.LEAVING
    scene.writer.end()


async def test_a_reliable_publisher_is_held_until_there_is_room() -> None:
    scene = Scene()
    scene.fill()
    changes, last = scene.changes, scene.parts[-1]
    assert scene.write(b"x") == 0 and scene.writer.lost == {}
    scene.writer.see_ack(RUN, last, 0)
    assert scene.changes == changes + 1
    assert scene.write(b"x") == 1 and scene.parts[-1] == last + 1
    scene.writer.end()


async def test_importers_are_asked_again_where_nothing_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(probing, "_FIRST_S", 0.001)
    scene = Scene()
    scene.fill()
    before = scene.probes
    await until(lambda: scene.probes >= before + 2)
    scene.writer.poll()
    scene.writer.poll()
    scene.writer.see_ack(RUN, scene.parts[-1], 0)
    scene.writer.end()
    after = scene.probes
    await asyncio.sleep(0.02)
    assert scene.probes == after


async def test_a_late_joiner_gets_messages_as_kept_ones_only_up_to_its_arrival() -> None:
    """Otherwise a fast publisher keeps it reading for ever."""
    scene = Scene(QoSProfile(10, durability="transient_local"))
    late = Interest("later", "late")
    scene.write(b"1", b"2")
    scene.writer.see_interests(HERE | {late})
    scene.writer.write(Loose([Sample(b"3", 3, 0)]))
    assert scene.kept(0, "late") == [1, 2] and scene.kept(2, "late") == [] == scene.kept(0)
    assert scene.parts == [1, 2]  # and message 3 as a part
    scene.writer.see_interests(HERE)
    scene.writer.see_interests(HERE | {late})
    assert scene.kept(0, "late") == [1, 2, 3]
    scene.writer.end()


async def test_another_bus_with_the_run_of_an_importer_changes_nothing_for_it() -> None:
    scene = Scene(LOSSLESS)
    scene.write(b"x")
    stranger = Interest("stranger", RUN)
    scene.writer.see_interests(HERE | {stranger})
    assert scene.writer._window.find(RUN, 0) is not None
    scene.writer.see_interests(HERE)
    assert scene.writer._window.find(RUN, 0) is not None
    scene.writer.see_interests(frozenset((stranger,)))
    scene.writer.see_interests(frozenset())
    assert scene.writer._window.find(RUN, 0) is None
    scene.writer.end()
