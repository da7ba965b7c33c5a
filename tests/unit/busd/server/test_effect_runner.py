"""busd.server.effect_runner: the order of messages to connections, and the calls of the server."""

import logging
from typing import Any

import pytest

from bus.base.ids import PeerId
from bus.transport.stream_state import WriteState
from bus.wire import messages as m
from busd.core.effects import Disconnect, Effect, Later, Note, Pause, Reload, Restart, Send, Stop
from busd.core.work import Meter
from busd.server import effect_runner
from busd.server.effect_runner import EffectRunner


class User:
    """The account of a user. `used` of `limit` bytes of control frames wait for its processes."""

    used = 0
    limit = 100


class Connection:
    """Replaces a connection. `calls` records the calls on all connections in order."""

    is_choked = False
    writing = WriteState.OPEN
    flushing_costs = 1

    def __init__(self, number: int, calls: list[Any], user: User | None = None) -> None:
        self.id = PeerId(number)
        self.stream = self.account = self
        self.parent = user
        self.used = 0
        self._calls = calls

    @property
    def is_user_over(self) -> bool:
        return self.parent is not None and self.parent.used > self.parent.limit

    def put(self, frame: bytes, descriptors: tuple[Any, ...]) -> None:
        self._calls.append(("put", self.id, frame))
        self.used += len(frame)
        if self.parent is not None:
            self.parent.used += len(frame)

    def flush(self) -> int:
        self._calls.append(("flush", self.id))
        return self.flushing_costs

    def wrote(self) -> None:
        self._calls.append(("wrote", self.id))

    def pause(self, seconds: float) -> None:
        self._calls.append(("pause", self.id, seconds))

    def relieve(self) -> None:
        self._calls.append(("relieve", self.id))


class Host:
    def __init__(self, calls: list[Any]) -> None:
        self._calls = calls

    def __getattr__(self, name: str) -> Any:
        return lambda subject: self._calls.append((name, getattr(subject, "id", subject)))


class World:
    """A runner for connections with the numbers 1 to `count`."""

    def __init__(self, count: int = 3, user: User | None = None) -> None:
        self.calls: list[Any] = []
        self.peers: dict[PeerId, Any] = {
            PeerId(number): Connection(number, self.calls, user) for number in range(1, count + 1)
        }
        self.meter = Meter(1000)
        self.runner = EffectRunner(self.meter, self.peers, Host(self.calls))

    def carry_out(self, *effects: Effect) -> list[Any]:
        """Returns the resulting calls."""
        self.calls.clear()
        self.runner.carry_out([*effects])
        return self.calls.copy()

    def flush(self, last: int | None = None) -> list[Any]:
        self.calls.clear()
        self.runner.flush(None if last is None else self.peers[PeerId(last)])
        return self.calls.copy()


PING = m.Ping(number=1)
FRAME = m.encode_frame(PING)
ONE, TWO = PeerId(1), PeerId(2)


def test_who_asked_is_answered_after_the_others_were_told() -> None:
    """A new subscription may rely on every publisher having been told of it."""
    world = World(20)
    for asker in world.peers:
        world.runner.dirty.update(world.peers.values())
        flushed = [number for _, number in world.flush(asker)]
        assert sorted(flushed) == [*world.peers]
        assert flushed[-1] == asker
    assert world.flush(1) == []


def test_a_flush_is_paid_for() -> None:
    """Each connection that receives something pays, also the one with the handled message."""
    world = World()
    world.carry_out(Send(ONE, PING), Send(TWO, PING))
    world.flush(1)
    assert world.meter.left == 1000 - 2 * (4 + 1)


@pytest.mark.parametrize("last", [None, 1])
def test_a_choked_one_is_asked_whether_it_can_be_read_again(last: int | None) -> None:
    world = World()
    world.peers[ONE].is_choked = True
    world.carry_out(Send(ONE, PING), Send(TWO, PING))
    calls = world.flush(last)
    assert calls[calls.index(("flush", 1)) + 1] == ("wrote", 1)
    assert ("wrote", 2) not in calls


def test_messages_wait_for_the_flush() -> None:
    world = World()
    assert world.carry_out(Send(ONE, PING), Send(TWO, PING), Send(ONE, PING)) == [
        ("put", 1, FRAME),
        ("put", 2, FRAME),
        ("put", 1, FRAME),
    ]
    assert sorted(world.flush()) == [("flush", 1), ("flush", 2)]


def test_a_message_for_many_is_encoded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    encoded = list[m.Message]()
    monkeypatch.setattr(effect_runner, "encode_frame", lambda message: encoded.append(message) or FRAME)
    other = m.Ping(number=1)
    World().carry_out(Send(ONE, PING), Send(TWO, PING), Send(PeerId(3), PING), Send(ONE, other))
    assert [message is PING for message in encoded] == [True, False]


def test_a_message_that_must_be_there_is_sent_at_once() -> None:
    world = World()
    world.runner.send(ONE, PING)
    assert world.calls == [("put", 1, FRAME), ("flush", 1)]
    assert not world.runner.dirty


def test_a_peer_that_has_gone_gets_nothing() -> None:
    world = World()
    gone = PeerId(9)
    assert world.carry_out(Send(gone, PING), Pause(gone, 1), Disconnect(gone, "")) == []


def test_a_peer_is_disconnected_once() -> None:
    world = World()
    assert world.carry_out(Disconnect(ONE, "why"), Disconnect(ONE, "again")) == [("disconnect", 1)]
    assert ONE not in world.peers


def test_the_rest_is_for_the_server() -> None:
    world = World()
    restart, reload = Restart(ONE, 1, "asked"), Reload(ONE, 2)
    effects = Later(ONE), Later(PeerId(9)), restart, reload
    assert world.carry_out(*effects) == [
        ("serve_later", 1),
        ("serve_later", 9),
        ("ask_restart", restart),
        ("ask_reload", reload),
    ]


def test_who_asks_for_the_end_is_answered_first() -> None:
    world = World()
    assert world.carry_out(Send(ONE, PING), Stop("asked")) == [
        ("put", 1, FRAME),
        ("flush", 1),
        ("stop", "asked"),
    ]


@pytest.mark.parametrize("writing", [WriteState.OPEN, WriteState.BLOCKED, WriteState.ENDED])
def test_a_pause_is_for_those_who_are_there(writing: WriteState) -> None:
    """busd reads the rest of a connection that has gone at once."""
    world = World()
    world.peers[ONE].writing = writing
    has_gone = writing is WriteState.ENDED
    assert world.carry_out(Pause(ONE, 1_500_000_000)) == ([] if has_gone else [("pause", 1, 1.5)])


def test_a_note_is_for_the_log(caplog: pytest.LogCaptureFixture) -> None:
    World().carry_out(Note(logging.WARNING, "100 % of it"))
    assert [(one.levelno, one.message) for one in caplog.records] == [(logging.WARNING, "100 % of it")]


class TestTooManyFrames:
    """Of a user's processes, busd cuts off the one with the most queued frames."""

    def test_after_all_effects(self) -> None:
        user = User()
        world = World(3, user)
        user.used, world.peers[TWO].used = user.limit, 50
        assert world.carry_out(Send(ONE, PING), Send(PeerId(3), PING))[2:] == [
            ("flush", 1),
            ("relieve", 2),
            ("flush", 3),
            ("relieve", 2),
        ]

    def test_not_where_the_socket_takes_them(self, monkeypatch: pytest.MonkeyPatch) -> None:
        user = User()
        world = World(3, user)
        user.used = user.limit
        monkeypatch.setattr(world.peers[ONE], "flush", lambda: setattr(user, "used", 0))
        assert world.carry_out(Send(ONE, PING)) == [("put", 1, FRAME)]

    def test_another_user_is_not_concerned(self) -> None:
        user, other = User(), User()
        world = World(2, user)
        world.peers[TWO].parent, world.peers[TWO].used, user.used = other, 500, user.limit
        assert ("relieve", 1) in world.carry_out(Send(ONE, PING))
