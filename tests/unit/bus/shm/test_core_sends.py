"""bus.shm._core.Sends: its awaitables behave like the coroutines of an async function."""

import asyncio
import collections.abc
import gc
import inspect
import sys
import weakref
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any

import pytest

from bus.base.callbacks import is_async
from shm_ends import core

PER_TURN = 100


class Room:
    """A publisher as Sends sees it. It has room for some messages, and then waits for more."""

    def __init__(self, room: int = 1 << 30, *, noted: bool = False) -> None:
        self.room = room
        self.noted = noted
        self.taken: list[Any] = []
        self.slowly: list[Any] = []
        self.told: list[Any] = []
        self.forgotten: list[Any] = []
        self.has_room = asyncio.Event()
        self.sends = core.Sends(self.send, self.go_on, self.forgotten.append)
        self.sends.publish = self.publish

    def publish(self, message: Any) -> bool | int:
        if isinstance(message, BaseException):
            raise message
        if len(self.taken) >= self.room:
            return False
        self.taken.append(message)
        return core.REPORT_DUE if self.noted else True

    def go_on(self, message: Any, status: Any) -> bool:
        self.told.append((message, status))
        return status is not None

    async def send(self, message: Any) -> None:
        self.slowly.append(message)
        while not self.publish(message):
            await self.has_room.wait()


def step(coroutine: Coroutine[Any, Any, Any]) -> Any:
    """Run the coroutine to its end, which it must reach in one step."""
    with pytest.raises(StopIteration) as end:
        coroutine.send(None)
    return end.value.value


async def test_a_message_is_published_when_it_is_awaited() -> None:
    room = Room()
    sending = room.sends.send("a")
    assert room.taken == []
    assert await sending is None
    assert (room.taken, room.slowly) == (["a"], [])


async def test_where_there_is_no_room_it_waits() -> None:
    room = Room(0)
    task = asyncio.create_task(room.sends.send("a"))
    for _ in range(3):
        await asyncio.sleep(0)
    assert not task.done() and room.slowly == ["a"]
    room.room = 1
    room.has_room.set()
    assert await task is None
    assert room.taken == ["a"]


async def test_without_a_quick_way_all_go_slowly() -> None:
    room = Room()
    del room.sends.publish
    await room.sends.send("a")
    assert (room.taken, room.slowly) == (["a"], ["a"])


async def test_what_is_noted_is_told() -> None:
    room = Room(noted=True)
    await room.sends.send("a")
    assert (room.told, room.taken, room.slowly) == ([("a", core.REPORT_DUE)], ["a"], [])


async def test_what_is_not_taken_after_all_goes_slowly() -> None:
    room = Room()
    room.sends.publish = lambda message: None
    await room.sends.send("a")
    assert (room.told, room.taken, room.slowly) == ([("a", None)], ["a"], ["a"])


RUNNERS: dict[str, Callable[[Any], Any]] = {
    "await": lambda sending: sending,
    "create_task": lambda sending: asyncio.create_task(sending),
    "ensure_future": lambda sending: asyncio.ensure_future(sending),
    "gather": lambda sending: asyncio.gather(sending),
    "wait_for": lambda sending: asyncio.wait_for(sending, 5),
    "shield": lambda sending: asyncio.shield(sending),
    "run_coroutine_threadsafe": lambda sending: asyncio.wrap_future(
        asyncio.run_coroutine_threadsafe(sending, asyncio.get_running_loop())
    ),
}


@pytest.mark.parametrize("name", RUNNERS)
@pytest.mark.parametrize("room", [0, 1])
async def test_all_that_takes_a_coroutine_takes_it(name: str, room: int) -> None:
    given = Room(room)
    asyncio.get_running_loop().call_soon(given.has_room.set)
    asyncio.get_running_loop().call_soon(setattr, given, "room", 1)
    await RUNNERS[name](given.sends.send("a"))
    assert given.taken == ["a"]
    with pytest.raises(ZeroDivisionError):
        await RUNNERS[name](given.sends.send(ZeroDivisionError()))


async def test_a_group_of_tasks_takes_it() -> None:
    room = Room()
    async with asyncio.TaskGroup() as group:
        for number in range(3):
            group.create_task(room.sends.send(number))
    assert room.taken == [0, 1, 2]


def test_it_can_be_run() -> None:
    taken: list[Any] = []

    async def never(message: Any) -> None:
        raise AssertionError

    sends = core.Sends(never, print, print)
    sends.publish = lambda message: taken.append(message) is None
    asyncio.run(sends.send("a"))
    assert taken == ["a"]


async def test_it_is_known_as_a_coroutine() -> None:
    room = Room()
    sending = room.sends.send("a")
    assert asyncio.iscoroutine(sending) and inspect.isawaitable(sending)
    assert isinstance(sending, collections.abc.Coroutine)
    assert (sending.__name__, sending.__qualname__) == ("send", "Publisher.send")  # type: ignore[attr-defined]
    assert repr(sending).startswith("<coroutine object Publisher.send at ")
    task = asyncio.create_task(sending)
    assert "Publisher.send" in repr(task)
    assert task.get_stack() == []
    await task
    assert is_async(room.sends.send)


async def test_it_is_good_for_once() -> None:
    room = Room()
    sending = room.sends.send("a")
    await sending
    for again in (lambda: sending.send(None), lambda: sending.throw(ValueError), lambda: sending.__await__()):
        with pytest.raises(RuntimeError, match="cannot reuse already awaited coroutine"):
            again()
    with pytest.raises(RuntimeError, match="cannot reuse already awaited coroutine"):
        await sending
    sending.close()
    assert room.taken == ["a"]


async def test_it_takes_no_value_at_first() -> None:
    sending = Room().sends.send("a")
    with pytest.raises(TypeError, match="just-started"):
        sending.send(1)
    assert step(sending) is None


async def test_what_was_cancelled_before_it_began_was_not_published() -> None:
    room = Room()
    task = asyncio.create_task(room.sends.send("a"))
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert (room.taken, room.slowly, room.forgotten) == ([], [], [])


async def test_what_was_cancelled_while_it_waits_was_not_published() -> None:
    room = Room(0)
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(room.sends.send("a"), 0.01)
    room.room = 1
    assert room.taken == []
    room.has_room.set()
    await room.sends.send("b")
    assert room.taken == ["b"]


async def test_what_was_closed_is_over() -> None:
    room = Room(0)
    begun, fresh = room.sends.send("a"), room.sends.send("b")
    begun.send(None)
    for one in (begun, fresh):
        one.close()
        one.close()
        with pytest.raises(RuntimeError, match="cannot reuse"):
            one.send(None)
    del begun, fresh, one
    assert (room.taken, room.forgotten) == ([], [])


async def test_what_is_thrown_comes_out() -> None:
    room = Room(0)
    begun = room.sends.send("a")
    begun.send(None)
    for one in (begun, room.sends.send("b")):
        with pytest.raises(ZeroDivisionError):
            one.throw(ZeroDivisionError)
        with pytest.raises(RuntimeError, match="cannot reuse"):
            one.send(None)
    assert room.taken == []


async def test_a_wait_goes_on_after_what_was_thrown_and_caught() -> None:
    caught: list[BaseException] = []

    async def stubborn(message: Any) -> None:
        try:
            await asyncio.Event().wait()
        except ZeroDivisionError as error:
            caught.append(error)
        await asyncio.sleep(0)

    sends = core.Sends(stubborn, print, print)
    sending = sends.send("a")
    sending.send(None)
    assert sending.throw(ZeroDivisionError("x")) is None
    assert step(sending) is None
    assert len(caught) == 1


async def test_within_itself_it_does_not_run() -> None:
    room = Room()
    refused: list[BaseException] = []

    def publish(message: Any) -> bool:
        for use in (lambda: sending.send(None), lambda: sending.throw(KeyError), sending.close):
            try:
                use()
            except (ValueError, RuntimeError) as error:
                refused.append(error)
        return True

    room.sends.publish = publish
    sending = room.sends.send("a")
    await sending
    assert [str(error) for error in refused] == ["coroutine already executing"] * 3


@pytest.mark.parametrize("begun_by", ["send", "throw"])
async def test_within_its_wait_it_does_not_run(begun_by: str) -> None:
    refused: list[str] = []

    def use_it() -> None:
        for use in (lambda: sending.send(None), lambda: sending.throw(KeyError), sending.close):
            with pytest.raises(ValueError, match="coroutine already executing") as error:
                use()
            refused.append(str(error.value))

    async def slow(message: Any) -> int:
        use_it()
        with suppress(ZeroDivisionError):
            await asyncio.sleep(0)
        use_it()
        return 5

    sending = core.Sends(slow, None, None).send("a")
    assert sending.send(None) is None
    assert len(refused) == 3
    with pytest.raises(StopIteration) as end:
        sending.send(None) if begun_by == "send" else sending.throw(ZeroDivisionError)
    assert end.value.value == 5
    assert len(refused) == 6


async def test_one_that_goes_on_after_it_was_closed_can_be_closed_again() -> None:
    async def slow(message: Any) -> None:
        with suppress(GeneratorExit):
            await asyncio.sleep(0)
        await asyncio.sleep(0)

    sending = core.Sends(slow, None, None).send("a")
    sending.send(None)
    with pytest.raises(RuntimeError, match="ignored GeneratorExit"):
        sending.close()
    sending.close()
    with pytest.raises(RuntimeError, match="already awaited"):
        sending.send(None)


async def test_one_may_be_sent_while_another_is() -> None:
    room = Room()

    def publish(message: Any) -> bool:
        if message == "outer":
            del room.sends.publish  # it is in use at this moment
            room.sends.publish = room.publish
            step(room.sends.send("inner"))
        return bool(room.publish(message))

    room.sends.publish = publish
    await room.sends.send("outer")
    assert room.taken == ["inner", "outer"]


@pytest.mark.parametrize("error", [ValueError("x"), KeyboardInterrupt(), SystemExit(3), StopIteration(5)])
async def test_what_the_quick_way_raises_comes_out(error: BaseException) -> None:
    room = Room()
    sending = room.sends.send(error)
    with pytest.raises(type(error)):
        sending.send(None)
    with pytest.raises(RuntimeError, match="cannot reuse"):
        sending.send(None)


def test_what_the_callables_raise_comes_out() -> None:
    def raises(*_: object) -> Any:
        raise ZeroDivisionError

    sends = core.Sends(raises, raises, print)
    for status in (False, core.REPORT_DUE):
        sends.publish = lambda _, status=status: status
        with pytest.raises(ZeroDivisionError):
            sends.send("a").send(None)
    with pytest.raises(ZeroDivisionError):
        sends.send("a").throw(KeyError)


@pytest.mark.parametrize("spares_turns", [False, True])
async def test_sends_that_never_wait_let_the_loop_turn(spares_turns: bool) -> None:
    room = Room()
    room.sends.spares_turns = spares_turns
    turns: list[int] = []

    def turn() -> None:
        turns.append(len(room.taken))
        loop.call_soon(turn)

    def publish(message: Any) -> bool:
        end = loop.time() + 1e-5  # so slow that the loop is due for a turn at each look
        while loop.time() < end:
            pass
        return bool(room.publish(message))

    room.sends.publish = publish
    loop = asyncio.get_running_loop()
    loop.call_soon(turn)
    for number in range(10 * PER_TURN):
        await room.sends.send(number)
    assert room.taken == list(range(10 * PER_TURN))
    assert turns == [*range(PER_TURN, 10 * PER_TURN, PER_TURN)]


async def test_turns_are_spared_while_the_last_is_not_long_ago() -> None:
    room = Room()
    room.sends.spares_turns = True
    turns = 0

    def turn() -> None:
        nonlocal turns
        turns += 1
        loop.call_soon(turn)

    loop = asyncio.get_running_loop()
    loop.call_soon(turn)
    begin = loop.time()
    for number in range(1000 * PER_TURN):
        await room.sends.send(number)
    took = loop.time() - begin
    assert 1 <= turns <= took / 0.0002 + 2


async def test_a_turn_that_is_cancelled_is_one_between_two_messages() -> None:
    room = Room()

    async def flood() -> None:
        for number in range(1 << 40):
            await room.sends.send(number)

    task = asyncio.create_task(flood())
    await asyncio.sleep(0.01)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert room.taken == list(range(len(room.taken)))
    assert len(room.taken) % PER_TURN == 0 and room.taken


async def test_what_nobody_awaits_is_told() -> None:
    room = Room()
    room.sends.send("a")
    assert room.forgotten == ["a"]
    sending = room.sends.send("b")
    del sending
    assert room.forgotten == ["a", "b"]


async def test_the_error_at_hand_stays_where_something_was_forgotten() -> None:
    room = Room()

    def forget() -> None:
        _sending = room.sends.send("a")
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        forget()
    gc.collect()
    assert room.forgotten == ["a"]


def test_what_goes_wrong_with_the_forgotten_is_not_raised() -> None:
    def raises(_: object) -> None:
        raise ZeroDivisionError

    seen: list[Any] = []
    hook, sys.unraisablehook = sys.unraisablehook, lambda told: seen.append(told.exc_type)
    try:
        core.Sends(print, print, raises).send("a")
    finally:
        sys.unraisablehook = hook
    assert seen == [ZeroDivisionError]


async def test_a_circle_through_a_wait_is_collected() -> None:
    class Message:
        pass

    room: Any = Room(0)
    message = Message()
    sending = room.sends.send(message)
    sending.send(None)
    message.own = sending  # type: ignore[attr-defined]
    room.sending = sending
    known = weakref.ref(message), weakref.ref(room)
    del sending, message, room
    gc.collect()
    assert [one() for one in known] == [None, None]


async def test_nothing_leaks() -> None:
    rounds = 2000
    room = Room()
    room.sends.publish = bool
    text = object()

    async def use() -> None:
        for _ in range(rounds):
            await room.sends.send(text)
            room.sends.send(text).close()
            with pytest.raises(ZeroDivisionError):
                room.sends.send(text).throw(ZeroDivisionError)
            waiting = room.sends.send("")
            del waiting
        room.forgotten.clear()

    await use()
    gc.collect()
    before = sys.getrefcount(text), sys.getrefcount(room.sends), sys.getallocatedblocks()
    await use()
    gc.collect()
    after = sys.getrefcount(text), sys.getrefcount(room.sends), sys.getallocatedblocks()
    assert after[:2] == before[:2]
    # A leak is a block in each round. The interpreter keeps about a hundred blocks; the number varies.
    assert abs(after[2] - before[2]) < rounds // 2


async def test_another_slow_way() -> None:
    async def first(message: str) -> None:
        raise AssertionError(message)

    taken: list[str] = []

    async def second(message: str) -> None:
        taken.append(message)

    sends = core.Sends(first, print, print)
    sends.slow = second
    await sends.send("a")
    assert taken == ["a"]
    del sends.slow
    with pytest.raises(AttributeError, match="slow"):
        await sends.send("b")
