"""Readers of DDS: every cell of their table. System tests with a domain test the messages."""

import asyncio
from collections.abc import Callable
from itertools import product
from types import SimpleNamespace
from typing import Any

import pytest

from bus_bridge.dds import raw
from bus_bridge.dds.reading import TRANSITIONS, FarWay, Intake, IntakeError, Ways
from bus_bridge.dds.reading import IntakeEvent as Event
from bus_bridge.dds.reading import IntakeState as State
from bus_bridge.rtps.policies import Policies
from semantics import until
from transitions import paths

KNOWN: Any = SimpleNamespace(depth=10, idl=None, codec=SimpleNamespace(decode=bytes))


class Endpoint:
    entity, guid = 1, bytes(16)

    def __init__(self) -> None:
        self.closes = 0
        self.matched: list[int] = []

    def matched_writers(self) -> list[int]:
        return self.matched

    def guid_of_writer(self, handle: int) -> bytes | None:
        return bytes([handle]) * 16 if handle else None

    def close(self) -> None:
        self.closes += 1


class Scene:
    """A reader that has reached `state`. Nothing has arrived."""

    def __init__(self, state: State, monkeypatch: pytest.MonkeyPatch) -> None:
        self.takes = 0
        self.endpoint = Endpoint()
        self.matches: list[bytes] = []
        self.ways = Ways(lambda handle: False, lambda intake, writer: self.matches.append(writer))
        monkeypatch.setattr(raw, "taker_of", lambda entity: self._take)
        self.intake = self.make()
        for event in paths(TRANSITIONS, State.OPEN)[state]:
            self.do(event)
        assert self.intake.state is state

    def make(self) -> Intake:
        """Make a reader, on `endpoint`."""
        endpoint = self.endpoint
        participant: Any = SimpleNamespace(make_reader=lambda *_: endpoint)
        intake = Intake(self.ways, participant, "/t", KNOWN, Policies(), b"")
        self.ways.add(intake)
        return intake

    def _take(self, most: int) -> list[object]:
        self.takes += 1
        return []

    def do(self, event: Event) -> None:
        doing: dict[Event, Callable[[], None]] = {
            Event.RETIRE: lambda: self.intake.on(Event.RETIRE),
            Event.CLOSE: self.intake.close,
        }
        doing[event]()


@pytest.mark.parametrize(("state", "event"), [*product(State, Event)])
async def test_every_cell(state: State, event: Event, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, following = Scene(state, monkeypatch), TRANSITIONS[state].get(event)
    if following is None:
        with pytest.raises(IntakeError) as caught:
            scene.intake.on(event)
        assert str(caught.value) == (
            f"a reader of DDS on '/t' is {state.value!r}: {event.value!r} can't happen to it"
        )
        following = state
    else:
        scene.do(event)
    assert scene.intake.state is following
    assert scene.endpoint.closes == (following is State.CLOSED)
    scene.intake.drain()
    assert scene.takes == (following is not State.CLOSED)


def test_every_state_has_a_row_and_can_be_reached() -> None:
    assert {*paths(TRANSITIONS, State.OPEN)} == {*State} == {*TRANSITIONS}


async def test_one_that_carries_nothing_ends_as_soon_as_it_retires(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene(State.OPEN, monkeypatch)
    scene.ways.retire(scene.intake)
    assert scene.intake.state is State.CLOSED and scene.endpoint.closes == 1
    scene.intake.close()
    await asyncio.sleep(0)
    assert scene.endpoint.closes == 1 and scene.takes == 0


async def test_one_that_retires_stays_until_a_new_one_is_matched(monkeypatch: pytest.MonkeyPatch) -> None:
    """The far writer does not know the new one yet."""
    scene = Scene(State.OPEN, monkeypatch)
    scene.endpoint.matched = [7]
    scene.intake.update_matches()
    way = FarWay(scene.ways, b"g" * 16, 7, "/t", KNOWN, lambda batch: None)
    scene.ways.begin(way, restores=False)
    scene.endpoint = Endpoint()
    latter = scene.make()
    scene.ways.retire(scene.intake)
    assert scene.intake.state is State.RETIRING and way.carrier is scene.intake
    scene.endpoint.matched = [7]
    latter.update_matches()
    await until(lambda: scene.intake.state is State.CLOSED)
    assert way.carrier is latter


async def test_each_new_match_is_reported_once(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene(State.OPEN, monkeypatch)
    for matched in ([7], [7, 8], [8], [8, 7], [0]):  # 0: a writer that has gone meanwhile
        scene.endpoint.matched = matched
        scene.intake.update_matches()
    assert scene.matches == [bytes([handle]) * 16 for handle in (7, 8, 7)]
