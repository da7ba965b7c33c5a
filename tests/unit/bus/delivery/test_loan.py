"""Loans: fields that can be lent, and the calls that a publisher allows while a loan is open."""

import gc
import sys
from collections.abc import Callable
from functools import partial
from itertools import count
from types import FrameType
from typing import Annotated, Any

import msgspec
import pytest
from msgspec import Meta

import bus.delivery.lending
from bus.errors import LocalProtocolError, MessageTypeError, PayloadTooLarge
from bus.publisher import Publisher
from bus.qos import QoSProfile
from bus.types.support import type_support
from bus.wire import messages as m
from busd.core.limits import Limits
from by_route import by_either, by_shared_memory
from client_world import Client, ClientWorld
from list_port import Task

LAST_10, KEEP_ALL = QoSProfile(10), QoSProfile(history="keep_all")
HISTORY = QoSProfile(10, durability="transient_local")


class Image(msgspec.Struct):
    number: int = 0
    data: bytes = b""
    frame: str = "camera"


class Listed(msgspec.Struct, array_like=True):
    number: int = 0
    data: bytes = b""


class Renamed(msgspec.Struct, rename="camel"):
    my_data: bytes = b""
    data: bytes = b""


class Tagged(msgspec.Struct, tag=True, omit_defaults=True):
    number: int = 0
    data: bytes = b""


class Later(Listed, array_like=True, kw_only=True):
    first: int = 7


class Short(msgspec.Struct):
    data: Annotated[bytes, Meta(min_length=3, max_length=10)] = b"..."


class ShortWithMore(msgspec.Struct):
    """A type without an encoding plan."""

    data: Annotated[bytes, Meta(min_length=3, max_length=10)] = b"..."
    more: dict[str, int] = {}


class Stage:
    """A publisher and a matched subscription."""

    def __init__(
        self, route: str, qos: QoSProfile = LAST_10, cls: Any = Image, *, limits: Limits | None = None
    ) -> None:
        self.shares = route == "shm"
        self.world = ClientWorld(limits)
        self.support = type_support(cls)
        self.talker, self.listener = self.client(), self.client()
        self.subscription = self.subscribe(self.listener, qos)
        self.publisher: Publisher[Any] = self.talker.publisher(qos, support=self.support)
        self.world.settle()

    def client(self, *, shares: bool | None = None) -> Client:
        return self.world.client(shares=self.shares if shares is None else shares)

    def subscribe(self, client: Client, qos: QoSProfile = LAST_10) -> Any:
        made = client.subscription(qos, support=self.support)
        self.world.settle()
        return made

    def loan(self, number: int = 1, size: Any = 100) -> Any:
        loan = self.publisher.loan(Image(number), "data", size)
        assert loan is not None
        return loan

    def publish(self, loan: Any) -> None:
        loan.buffer[:] = b"y" * len(loan.buffer)
        assert loan.publish() is True
        self.world.settle()

    def heard(self, subscription: Any = None) -> list[Any]:
        found = []
        while (taken := (subscription or self.subscription).take()) is not None:
            found.append(taken[0])
        return found

    def numbers(self, subscription: Any = None) -> list[int]:
        return [message.number for message in self.heard(subscription)]


@by_either
@pytest.mark.parametrize(
    ("message", "field"),
    [
        (Image(3), "data"),
        (Listed(3), "data"),
        (Renamed(), "my_data"),
        (Renamed(my_data=b"other"), "data"),
        (Tagged(), "data"),
        (Later(3), "data"),
        (Short(), "data"),
        (ShortWithMore(), "data"),
    ],
    ids=lambda value: getattr(type(value), "__name__", "") if isinstance(value, msgspec.Struct) else value,
)
def test_of_every_kind_of_class(route: str, message: Any, field: str) -> None:
    stage = Stage(route, cls=type(message))
    stage.publish(stage.publisher.loan(message, field, 5))
    assert stage.heard() == [msgspec.structs.replace(message, **{field: b"yyyyy"})]


@by_either
@pytest.mark.parametrize("cls", [Short, ShortWithMore])
@pytest.mark.parametrize("size", [2, 11])
def test_of_a_length_that_the_type_does_not_allow(route: str, cls: Any, size: int) -> None:
    stage = Stage(route, cls=cls)
    with pytest.raises(MessageTypeError, match=r"of length .* at `\$\.data`"):
        stage.publisher.loan(cls(), "data", size)
    stage.publish(stage.publisher.loan(cls(), "data", 4))
    assert len(stage.heard()) == 1


@by_either
@pytest.mark.parametrize("size", [1 << 27, 1 << 32, 1 << 40, 1 << 70])
def test_of_more_bytes_than_a_message_may_have(route: str, size: int) -> None:
    stage = Stage(route)
    with pytest.raises(PayloadTooLarge):
        stage.loan(size=size)
    stage.publisher.publish(Image(2))


@by_either
def test_of_what_is_no_size(route: str) -> None:
    stage = Stage(route)
    with pytest.raises(ValueError, match="-1 bytes"):
        stage.loan(size=-1)
    with pytest.raises(TypeError):
        stage.loan(size=2.0)
    stage.publisher.publish(Image(2))


@by_either
def test_of_a_size_that_is_another_kind_of_integer(route: str) -> None:
    class Seven:
        def __index__(self) -> int:
            return 7

    stage = Stage(route)
    stage.publish(stage.loan(size=Seven()))
    assert [len(message.data) for message in stage.heard()] == [7]


@by_either
def test_that_could_not_be_published_has_ended_all_the_same(
    route: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = Stage(route)
    far = stage.client(shares=False)
    also = stage.subscribe(far)
    loan, waited = stage.loan(), []

    async def wait() -> None:
        await stage.publisher.wait_for_room()
        waited.append(True)

    Task(stage.talker.soon, wait())
    stage.talker.run_once()

    def fail(_: object) -> None:
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr(bus.delivery.lending, "bytes", fail, raising=False)
        with pytest.raises(MemoryError):
            loan.publish()
    stage.publisher.publish(Image(2))
    stage.world.settle()
    assert waited
    assert stage.numbers() == stage.numbers(also) == [2]


@by_either
def test_that_the_next_broker_finds_too_large(route: str) -> None:
    stage = Stage(route)
    loan = stage.loan(size=100_000)
    stage.world._limits = Limits(message_bytes=70_000)
    stage.world.restart_broker()
    stage.world.connect_all()
    stage.world.settle()
    with pytest.raises(PayloadTooLarge, match="the limit is 70000"):
        loan.publish()
    stage.publisher.publish(Image(2))
    stage.world.settle()
    assert stage.numbers() == [2]


@by_either
@pytest.mark.parametrize("is_back", [False, True])
def test_across_the_loss_of_the_broker(route: str, is_back: bool) -> None:
    stage = Stage(route)
    loan = stage.loan()
    stage.talker.hang_up()
    stage.world.settle()
    if is_back:
        stage.talker.connect()
        stage.world.settle()
    stage.publish(loan)
    if not is_back:
        stage.talker.connect()
    stage.publisher.publish(Image(2))
    stage.world.settle()
    assert stage.numbers() == [1, 2]


@pytest.mark.parametrize("qos", [LAST_10, KEEP_ALL, HISTORY], ids=["last", "all", "history"])
@by_either
def test_with_a_match_by_socket_that_is_made_meanwhile(route: str, qos: QoSProfile) -> None:
    stage = Stage(route, qos)
    # Step by step, because the quick way stamps by the machine's clock, which is ahead of the world's.
    stage.publisher._put(stage.support.encode(Image(0)))
    loan = stage.loan()
    late = stage.subscribe(stage.client(shares=False), qos)
    stage.publish(loan)
    stage.publisher.publish(Image(2))
    stage.world.settle()
    assert stage.numbers() == [0, 1, 2]
    assert stage.numbers(late) == ([0, 1, 2] if qos is HISTORY else [1, 2])


@by_shared_memory
def test_with_a_match_that_leaves_the_ring_meanwhile() -> None:
    stage = Stage("shm")
    stage.publisher.publish(Image(0))
    loan = stage.loan()
    refusal = m.RefuseRoute(
        endpoint=stage.subscription._core.id, other=stage.publisher._core.id, text="a test"
    )
    stage.listener.send_about(stage.subscription._core, refusal)
    stage.world.settle()
    stage.publish(loan)
    stage.publisher.publish(Image(2))
    stage.world.settle()
    assert stage.numbers() == [0, 1, 2]
    assert not stage.subscription.statistics().dropped


@by_shared_memory
def test_with_matches_that_ask_for_a_larger_ring_meanwhile() -> None:
    stage = Stage("shm")
    loan = stage.loan()
    deep = stage.subscribe(stage.client(), QoSProfile(2_000))
    stage.world.advance(3)
    stage.publish(loan)
    stage.publisher.publish(Image(2, bytes(3 << 20)))
    stage.world.settle()
    assert stage.numbers() == stage.numbers(deep) == [1, 2]


@by_either
def test_that_only_a_cycle_holds_ends_with_it(route: str) -> None:
    stage = Stage(route)
    loan: Any = stage.loan()
    cycle = [loan]
    cycle.append(cycle)
    gc.disable()  # otherwise the collector may collect it before the test looks
    try:
        del loan, cycle
        with pytest.raises(LocalProtocolError, match="is open"):
            stage.publisher.publish(Image(1))
    finally:
        gc.enable()
    gc.collect()
    stage.publisher.publish(Image(2))
    stage.world.settle()
    assert stage.numbers() == [2]


@by_either
def test_that_ends_on_another_thread(route: str) -> None:
    stage = Stage(route)
    loan = stage.loan()
    stage.talker.is_mine = False
    with pytest.raises(LocalProtocolError, match="event loop's thread"):
        loan.publish()
    stage.talker.is_mine = True
    stage.world.settle()
    stage.publisher.publish(Image(2))
    stage.world.settle()
    assert stage.numbers() == [2]


class Interrupted(BaseException):
    pass


def break_off_after(steps: int, call: Callable[[], Any]) -> Any:
    """Return the result of `call`. After `steps` calls and returns in it, Interrupted is raised, as by a
    signal.
    """
    left = steps

    def break_off(frame: FrameType, event: str, called: object) -> None:
        nonlocal left
        left -= called is not sys.setprofile
        if not left:
            raise Interrupted

    # A collection calls back into hypothesis, and Interrupted would be raised there instead of in `call`.
    gc.disable()
    sys.setprofile(break_off)
    try:
        return call()
    finally:
        sys.setprofile(None)
        gc.enable()


@by_either
@pytest.mark.parametrize("is_quick", [True, False])
def test_whose_making_is_broken_off_at_any_step(route: str, is_quick: bool) -> None:
    stage = Stage(route, cls=Image if is_quick else ShortWithMore)
    message = stage.support.cls()
    stage.publisher.loan(message, "data", 5)  # makes the objects that are made only once
    for steps in count(1):
        try:
            loan = break_off_after(steps, partial(stage.publisher.loan, message, "data", 5))
        except Interrupted:  # its traceback refers to the new objects
            pass
        else:
            break
        stage.publisher.publish(message)
    assert steps > 3
    assert loan is not None
    loan.buffer[:] = b"abcde"
    assert loan.publish()
    stage.world.settle()
    assert stage.subscription.statistics().expected == steps


@by_either
def test_whose_publishing_is_broken_off_at_any_step(route: str) -> None:
    """An interrupted publish has ended the loan, or the loan can still be ended."""
    stage = Stage(route, KEEP_ALL)
    stage.publish(stage.loan(0))
    for steps in count(1):
        loan = stage.loan(steps)
        try:
            break_off_after(steps, loan.publish)
            break
        except Interrupted:
            loan.discard()
            stage.publisher.publish(Image(-steps))
    assert steps > 3
    stage.world.settle()
    heard = stage.numbers()
    assert [number for number in heard if number < 0] == [-step for step in range(1, steps)]
    assert heard[-1] == steps
    assert sorted(set(heard)) == sorted(heard)


@by_either
def test_beyond_the_depth_the_newest_stay(route: str) -> None:
    stage = Stage(route, QoSProfile(3))
    for number in range(10):
        loan = stage.loan(number, 300_000)
        loan.publish()
    stage.world.settle()
    assert stage.numbers() == [7, 8, 9]
    assert stage.subscription.statistics().dropped == {"replaced": 7}


@by_either
def test_of_keep_all_there_are_no_more_than_have_room(route: str) -> None:
    stage = Stage(route, KEEP_ALL, limits=Limits(ring_bytes=8 << 20, keep_all_window_bytes=8 << 20))
    count = 0
    while (loan := stage.publisher.loan(Image(count), "data", 1 << 20)) is not None:
        assert loan.publish()
        count += 1
        assert count < 100
    assert count > 1
    assert stage.publisher.statistics().refused == 1
    stage.world.settle()
    assert stage.numbers() == [*range(count)]
    stage.world.advance(1)
    stage.publish(stage.loan(count, 1 << 20))
    assert stage.numbers() == [count]


def test_for_which_other_threads_leave_no_room_is_refused_and_counted() -> None:
    stage = Stage("socket", KEEP_ALL, limits=Limits(keep_all_window_messages=10))
    loan, encoded = stage.loan(), stage.support.encode(Image(2))
    stage.talker.is_mine = False
    for _ in range(10):
        assert stage.publisher._put(encoded)
    stage.talker.is_mine = True
    assert loan.publish() is False
    assert stage.publisher.statistics().refused == 1
    stage.world.settle()
    assert stage.numbers() == [2] * 10
    stage.world.advance(1)
    stage.publish(stage.loan(3))
    assert stage.numbers() == [3]
