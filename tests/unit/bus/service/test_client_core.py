"""Calls of a service client: answered, lost with a server, with busd or on a bridge. No bus, no clock."""

from collections.abc import Callable
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from bus.delivery.port import RETURN_S
from bus.errors import ConnectionClosed, LocalProtocolError, ServiceError, ServiceUnavailable
from bus.events import MatchedChange
from bus.qos import QoSProfile
from bus.service import client_core as module
from bus.service.client_core import MAX_PENDING, CallLost, ClientCore
from bus.srv.example_interfaces import AddTwoInts
from bus.types.service import Reply
from bus.vocabulary import Route
from rows import for_each

GID = b"client gid......"
ONE, OTHER = b"one", b"other"
"""Servers, as gids of their subscriptions; their publishers of replies have the same here."""


class Loop:
    """Calls what is due, as time passes."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self._waiting: list[tuple[float, Callable[[], object]]] = []

    def call_later(self, delay_s: float, action: Callable[[], object]) -> Any:
        entry = (self.now_s + delay_s, action)
        self._waiting.append(entry)
        return SimpleNamespace(cancel=lambda: self._waiting.remove(entry))

    def call_soon_threadsafe(self, action: Callable[[], object]) -> None:
        action()

    def advance(self, seconds: float) -> None:
        end_s = self.now_s + seconds
        while due := [entry for entry in self._waiting if entry[0] <= end_s]:
            first = min(due, key=lambda entry: entry[0])
            self._waiting.remove(first)
            self.now_s = first[0]
            first[1]()
        self.now_s = end_s


class World(ClientCore):
    """A client whose two endpoints are played by the test."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.loop = Loop()
        self.outcomes: dict[int, Any] = {}
        self.sent: list[tuple[int, bool]] = []
        """Number of the call, and whether it is a question about it."""
        self.has_room = True
        self.waiting: list[tuple[Reply, Any]] = []
        """Replies that the subscription has, and has not passed on."""
        self._endpoint = SimpleNamespace(id=1, refusal=None, count_ready=lambda: len(self.requests.matches))
        self._repliers_core = SimpleNamespace(matches={}, replace_callback=self._use)
        monkeypatch.setattr(module, "monotonic_ns", lambda: int(self.loop.now_s * 1e9) + 1)
        monkeypatch.setattr(module, "warn", lambda logger, text: None)
        node: Any = SimpleNamespace(link=SimpleNamespace(loop=self.loop), logger=None)
        super().__init__(node, "/add", AddTwoInts, QoSProfile())

    def make_publisher(self, *_: object) -> Any:
        return SimpleNamespace(gid=GID, matches=[], publish_encoded=self._publish, _core=self._endpoint)

    def make_subscription(self, topic: str, support: object, callback: Any, *_: object) -> Any:
        self._use(callback)
        take = lambda: self.waiting.pop(0) if self.waiting else None  # noqa: E731
        return SimpleNamespace(take=take, _core=self._repliers_core)

    def _use(self, callback: Any) -> None:
        self._callback = callback

    def _publish(self, payload: bytes) -> bool:
        _, number, body = msgspec.msgpack.decode(payload)
        self.sent += [(number, body is None)] * self.has_room
        return self.has_room

    def ask(self) -> int:
        return self.send(AddTwoInts.Request(a=1, b=2), self.outcomes.__setitem__)

    def answer(self, number: int, body: Any = "sum", *, error: str = "", by: bytes = ONE) -> None:
        reply = Reply(GID, number, error, body)
        if self._callback == self._take:
            self._callback(reply)
        else:
            self._callback(reply, SimpleNamespace(publisher_gid=by))

    def serve(self, *gids: bytes, route: Route = Route.SOCKET) -> None:
        """From now on these servers exist, and no others."""
        before = len(self.requests.matches)
        matches: Any = [SimpleNamespace(gid=gid, route=route) for gid in gids]
        self.requests.matches[:] = matches  # type: ignore[index]
        self._repliers_core.matches = dict(enumerate(matches))
        change = MatchedChange(len(gids), len(gids), len(gids), len(gids) - before, "/server")
        self._on_replier(change)
        self._on_matched(change)

    def lose_busd(self) -> None:
        self._endpoint.id = 0
        self.serve()

    def find_busd(self, *gids: bytes) -> None:
        self._endpoint.id = 2
        self.serve(*gids)

    @property
    def questions(self) -> int:
        return sum(is_question for _, is_question in self.sent)


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    made = World(monkeypatch)
    made.serve(ONE)
    return made


def test_answers(world: World) -> None:
    first, second = world.ask(), world.ask()
    world.answer(second)
    world.answer(first, None, error="no sums today")
    assert world.outcomes[second] == "sum"
    assert isinstance(world.outcomes[first], ServiceError)
    world.answer(first)
    totals = world.statistics()
    assert (totals.requests, totals.responses, totals.errors, totals.late, totals.pending) == (2, 2, 1, 1, 0)


def test_no_answer_is_expected_of_a_request_without_room(world: World) -> None:
    world.has_room = False
    assert world.ask() == 0
    assert world.statistics().pending == 0


def test_most_calls_that_wait(world: World) -> None:
    for _ in range(MAX_PENDING):
        world.ask()
    with pytest.raises(LocalProtocolError, match="1000 calls of service '/add' wait"):
        world.ask()
    assert world.forget(1) and not world.forget(1)
    assert world.ask()


def test_a_server_that_leaves_before_its_answer(world: World) -> None:
    number = world.ask()
    world.serve()
    world.loop.advance(module._GRACE_S - 0.01)
    assert world.outcomes == {}
    world.loop.advance(0.02)
    assert isinstance(world.outcomes[number], ServiceUnavailable)
    assert "it has left before it answered" in str(world.outcomes[number])


def test_a_server_that_had_only_lost_its_connection(world: World) -> None:
    first, second = world.ask(), world.ask()
    world.serve()
    world.serve(ONE)
    assert world.questions == 2
    world.loop.advance(1)
    assert world.outcomes == {}
    world.answer(first)
    world.answer(second, None)
    assert world.outcomes[first] == "sum"
    assert isinstance(world.outcomes[second], CallLost)


@for_each("is_doubtful", [False, True])
def test_another_server_does_not_bring_back_a_lost_call(world: World, is_doubtful: bool) -> None:
    world.serve(ONE)
    number = world.ask()
    if is_doubtful:
        world.lose_busd()
        world.find_busd(ONE)
    world.serve()
    world.serve(OTHER)
    world.loop.advance(1)
    assert isinstance(world.outcomes[number], ServiceUnavailable)


def test_an_answer_that_comes_after_the_report_that_the_server_has_left(world: World) -> None:
    first, second = world.ask(), world.ask()
    world.serve()
    world.answer(first)
    world.waiting = [(Reply(GID, second, "", "late sum"), SimpleNamespace(publisher_gid=ONE))]
    world.loop.advance(1)
    assert world.outcomes == {first: "sum", second: "late sum"}


def test_another_server_may_still_answer(world: World) -> None:
    world.serve(ONE, OTHER)
    number = world.ask()
    world.serve(OTHER)
    world.loop.advance(10)
    assert world.outcomes == {}
    world.serve()
    world.loop.advance(1)
    assert isinstance(world.outcomes[number], ServiceUnavailable)


def test_a_call_that_busd_has_lost_is_denied_by_its_server(world: World) -> None:
    number = world.ask()
    world.lose_busd()
    world.loop.advance(5)
    assert world.questions == 0
    world.find_busd(ONE)
    assert world.questions == 1
    world.answer(number, None)
    assert isinstance(world.outcomes[number], CallLost)
    assert "busd, or a connection to it, has ended meanwhile" in str(world.outcomes[number])


def test_a_server_that_still_works_on_it_is_asked_ever_less_often(world: World) -> None:
    world.ask()
    world.lose_busd()
    world.find_busd(ONE)
    asked_at = []
    for second in range(80):
        before = world.questions
        world.loop.advance(1)
        asked_at += [second] * (world.questions - before)
    pauses = [later - earlier for earlier, later in pairwise(asked_at)]
    assert pauses == [2, 4, 8, 16, 16, 16, 16]
    assert world.outcomes == {}


def test_a_server_that_does_not_come_back_with_busd(world: World) -> None:
    number = world.ask()
    world.lose_busd()
    world.loop.advance(30)
    assert world.outcomes == {}
    world.find_busd(OTHER)
    world.loop.advance(RETURN_S - 1)
    assert world.outcomes == {}
    world.loop.advance(3)
    assert isinstance(world.outcomes[number], ServiceUnavailable)
    assert "it has left while busd was away" in str(world.outcomes[number])


@for_each(("denied_by", "is_lost"), [([ONE], False), ([ONE, ONE], False), ([OTHER, ONE], True)])
def test_a_call_is_lost_once_all_servers_deny_it(world: World, denied_by: list[bytes], is_lost: bool) -> None:
    world.serve(ONE, OTHER)
    number = world.ask()
    for gid in denied_by:
        world.answer(number, None, by=gid)
    assert isinstance(world.outcomes.get(number), CallLost) is is_lost


def test_over_a_bridge_a_call_may_be_lost_without_notice(world: World) -> None:
    world.serve(ONE, route=Route.BRIDGE)
    number = world.ask()
    world.loop.advance(module._LOOK_S + 0.1)
    assert world.questions == 0  # most answers come sooner
    world.loop.advance(module._LOOK_S)
    assert world.questions == 1
    world.answer(number, None)
    assert "on the way to or from another bus" in str(world.outcomes[number])


def test_the_end_of_the_client(world: World) -> None:
    number = world.ask()
    world.lose_busd()
    reason = ConnectionClosed("closed")
    world.end(reason)
    assert world.outcomes == {number: reason}
    world.loop.advance(100)
