"""busd.server.shutdown: the connections that busd reads to their ends, its messages, and the time limit."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from bus.transport.stream_state import ReadState
from busd.server import shutdown
from busd.server.shutdown import Drain

LONGEST_S = 1.0
STEP_S = 1 / 32  # its sums are exact


class Connection:
    """Replaces a connection and its stream."""

    def __init__(self, world: "World", name: str) -> None:
        self.name = name
        self.reading = ReadState.OPEN
        self.is_drained = True
        self.stream = self
        self.outbox = SimpleNamespace(samples=7)
        self.credentials = SimpleNamespace(pid=4711)
        self._world = world

    def leave(self, text: str) -> None:
        self._world.calls.append(f"{self.name} learns: {text}")

    def drain_input(self) -> None:
        self._world.calls.append(f"{self.name} is heard out")
        self.reading = ReadState.ENDED

    def close(self) -> None:
        self._world.calls.append(f"{self.name} is closed")
        self.reading = ReadState.CLOSED


class World:
    """Connections, a clock, and an event loop with one timer."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.connections: list[Connection] = []
        self.now_s = 100.0
        self.timers: list[Any] = []
        self.polls: list[float] = []

    def call_later(self, delay_s: float, action: Any) -> Any:
        self.timers.append(action)
        return SimpleNamespace(cancel=lambda: self.timers.remove(action))

    def connect(self, *names: str) -> list[Connection]:
        made = [Connection(self, name) for name in names]
        self.connections += made
        return made

    def drain(self) -> Drain:
        drain = Drain(
            self.connections,  # type: ignore[arg-type]
            "busd stops",
            longest_s=LONGEST_S,
            on_poll=lambda: self.polls.append(self.now_s),
            on_heard=lambda: self.calls.append("heard"),
            on_end=lambda: self.calls.append("end"),
        )
        assert len(self.timers) == ("end" not in self.calls)
        return drain

    def wait(self, seconds: float = STEP_S) -> list[str]:
        """Let the timer fire after this time. Returns the resulting calls."""
        self.calls.clear()
        self.now_s += seconds
        (action,) = self.timers
        self.timers.clear()
        action()
        return self.calls.copy()


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    world = World()
    monkeypatch.setattr(shutdown, "monotonic", lambda: world.now_s)
    monkeypatch.setattr(asyncio, "get_running_loop", lambda: world)
    return world


def test_without_connections_it_ends_at_once(world: World) -> None:
    world.drain()
    assert world.calls == ["heard", "end"]


def test_all_learn_of_it_and_nobody_is_closed_while_one_may_send(world: World) -> None:
    """Messages of one connection may be for the others."""
    one, other = world.connect("one", "other")
    world.drain()
    assert world.calls == ["one learns: busd stops", "other learns: busd stops"]
    one.reading = ReadState.ENDED
    assert world.wait() == []
    other.reading = ReadState.ENDED
    assert world.wait() == ["heard", "one is closed", "other is closed", "end"]
    assert world.timers == []


def test_what_waits_is_sent_first(world: World) -> None:
    one, other = world.connect("one", "other")
    world.drain()
    one.reading = other.reading = ReadState.ENDED
    one.is_drained = False
    assert world.wait() == ["heard", "other is closed"]
    assert world.wait() == ["heard"]
    one.is_drained = True
    assert world.wait() == ["heard", "one is closed", "end"]


def test_half_of_the_time_is_for_those_who_send(world: World) -> None:
    """If a connection goes on sending, busd takes the data that has arrived by then."""
    one, other = world.connect("one", "other")
    world.drain()
    other.reading = ReadState.ENDED
    for _ in range(round(LONGEST_S / 2 / STEP_S) - 1):
        assert world.wait() == []
    assert world.wait() == ["one is heard out"]
    assert one.reading is ReadState.ENDED
    assert world.wait() == ["heard", "one is closed", "other is closed", "end"]


def test_after_the_whole_time_nobody_is_waited_for(world: World, caplog: pytest.LogCaptureFixture) -> None:
    one, other = world.connect("one", "other")
    world.drain()
    one.reading = other.reading = ReadState.ENDED
    one.is_drained = False
    assert world.wait() == ["heard", "other is closed"]
    for _ in range(round(LONGEST_S / STEP_S) - 2):
        assert world.wait() == ["heard"]
    assert world.wait() == ["heard", "one is closed", "end"]
    assert [record.message for record in caplog.records] == ["pid 4711 does not read: 7 samples were lost"]


def test_between_them_others_may_be_served(world: World) -> None:
    world.connect("one")
    world.drain()
    assert world.polls == []
    for count in (1, 2):
        world.wait()
        assert len(world.polls) == count
        assert world.polls[-1] == world.now_s


def test_peers_do_not_pay_for_a_busd_that_stood_still(world: World) -> None:
    world.connect("one")
    world.drain()
    assert world.wait(3600) == []
    assert world.wait(0) == []


def test_an_end_at_once(world: World) -> None:
    one, _ = world.connect("one", "other")
    drain = world.drain()
    one.is_drained = False
    world.calls.clear()
    drain.end()
    assert world.calls == [
        "one is heard out",
        "other is heard out",
        "heard",
        "one is closed",
        "other is closed",
        "end",
    ]
    assert world.timers == []


def test_one_that_is_lost_meanwhile(world: World) -> None:
    one, other = world.connect("one", "other")
    world.drain()
    other.reading, one.reading = ReadState.ENDED, ReadState.CLOSED
    assert world.wait() == ["heard", "other is closed", "end"]
