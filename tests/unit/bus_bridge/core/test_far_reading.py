"""Every cell of the table of a reading, and the effect of its states."""

from itertools import product
from typing import Any

import pytest

from bus.msg.std_msgs import String
from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus_bridge.core import far_reading
from bus_bridge.core.far_reading import TRANSITIONS, FarReading, ReadingError
from bus_bridge.core.far_reading import ReadingEvent as Event
from bus_bridge.core.far_reading import ReadingState as State
from bus_bridge.engine import FarEndpoint
from bus_bridge.errors import BridgeError
from semantics import until
from transitions import paths


class Engine:
    """Also stands for its readers."""

    def __init__(self) -> None:
        self.fails = False
        self.restores: list[bool] = []
        self.begins = self.reads = self.closes = self.retries = 0
        self.lost: dict[str, int] = {}

    def begin(self) -> None:
        self.begins += 1

    def retry(self) -> None:
        self.retries += 1

    def read(self, *_: object, restores: bool) -> "Engine":
        self.restores.append(restores)
        if self.fails:
            raise BridgeError("the publisher is not known yet")
        self.reads += 1
        return self

    def close(self) -> None:
        self.closes += 1


class Scene:
    """A reading that has reached `state`."""

    def __init__(self, state: State = State.IDLE) -> None:
        self.engine = engine = Engine()
        self.troubles: list[str] = []
        schema = MessageSchema.of(String)
        endpoint = FarEndpoint(
            "publisher", bytes(16), "far/1", "/t", schema.type_name, schema.type_hash, QoSProfile(10)
        )
        any_engine: Any = engine
        self.reading = FarReading(
            any_engine, endpoint, schema, print, engine.begin, engine.retry, self.troubles.append
        )
        engine.fails = state is State.FAILED
        for event in paths(TRANSITIONS, State.IDLE)[state]:
            if event is not Event.FAIL:  # the engine fails by itself
                self.do(event)
        engine.fails = False
        self.check(state)

    def do(self, event: Event) -> None:
        match event:
            case Event.WANT | Event.UNWANT:
                self.reading.want(event is Event.WANT)
            case Event.STOP:
                self.reading.stop()
            case Event.CLOSE:
                self.reading.close()
            case Event.FAIL:
                self.reading._on(event)

    def check(self, state: State) -> None:
        """Check the effect of the state."""
        reading, engine = self.reading, self.engine
        assert reading.state is state
        assert reading.is_flowing is (state in (State.READING, State.LINGERING))
        assert engine.reads - engine.closes == reading.is_flowing
        assert (reading._timer is not None) is (state in (State.LINGERING, State.FAILED))


@pytest.mark.parametrize(("state", "event"), [*product(State, Event)])
async def test_every_cell(state: State, event: Event) -> None:
    scene, following = Scene(state), TRANSITIONS[state].get(event)
    if following is None:
        with pytest.raises(ReadingError) as caught:
            scene.do(event)
        assert str(caught.value) == (
            f"the reading of '/t' is {state.value!r}: {event.value!r} can't happen to it"
        )
        scene.check(state)
        return
    scene.do(event)
    if event is Event.FAIL:  # the next tests check the further effects of a failure
        assert scene.reading.state is following
    else:
        scene.check(following)
    scene.reading.close()


def test_every_state_has_a_row_and_can_be_reached() -> None:
    assert {*paths(TRANSITIONS, State.IDLE)} == {*State} == {*TRANSITIONS}


async def test_each_reader_begins_once() -> None:
    scene = Scene(State.LINGERING)
    scene.reading.want(True)
    scene.check(State.READING)
    assert (scene.engine.begins, scene.engine.reads) == (1, 1)
    scene.reading.stop()
    scene.reading.want(True)
    assert (scene.engine.begins, scene.engine.reads, scene.engine.closes) == (2, 2, 1)


async def test_it_lingers_for_a_while_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(far_reading, "_LINGER_S", 0.01)
    scene = Scene(State.LINGERING)
    await until(lambda: not scene.reading.is_flowing)
    scene.check(State.IDLE)


async def test_a_failure_is_said_and_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(far_reading, "_RETRY_S", 0.01)
    scene = Scene(State.FAILED)
    assert scene.troubles == ["the publisher is not known yet"]
    await until(lambda: scene.engine.retries)
    scene.reading.want(True)
    scene.check(State.READING)
    assert scene.engine.retries == 1


async def test_kept_messages_are_needed_again_once() -> None:
    scene = Scene()
    scene.reading.resume({}, restores=True)
    scene.engine.fails = True
    scene.reading.want(True)
    scene.engine.fails = False
    for _ in range(2):
        scene.reading.stop()
        scene.reading.want(True)
    assert scene.engine.restores == [True, True, False]


async def test_what_all_readers_have_lost_is_added_up() -> None:
    scene = Scene()
    scene.reading.resume({"undecodable": 1}, restores=False)
    assert scene.reading.lost == {"undecodable": 1}
    scene.reading.want(True)
    scene.engine.lost = {"undecodable": 2, "link_full": 1}
    assert scene.reading.lost == {"undecodable": 3, "link_full": 1}
    scene.reading.stop()
    scene.reading.want(True)
    scene.engine.lost = {"link_full": 4}
    assert scene.reading.lost == {"undecodable": 3, "link_full": 5}
    scene.reading.close()
    assert scene.reading.lost == {"undecodable": 3, "link_full": 5}
