"""bus.endpoint.arrivals: the first task that waits is woken with the message; the others wait on."""

import asyncio
from collections import deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from bus.endpoint.arrivals import Arrivals
from bus.errors import LocalProtocolError


class Reader:
    """Stands for the native reader: calls back while all queues are empty."""

    def __init__(self) -> None:
        self.callback: Callable[[Any], object] | None = None
        self.queues: tuple[Any, ...] = ()

    def forget_callback(self) -> None:
        self.callback = None

    def arrives(self, taken: Any) -> bool:
        if self.callback is None or any(map(len, self.queues)):
            return False
        self.callback(taken)
        return True


class Receiver:
    def __init__(self) -> None:
        self.reader = Reader()
        self.ahead: deque[Any] = deque()
        self.lone: Any = None

    def call_back_with_taken(self, callback: Callable[[Any], object], on_error: Any, *others: Any) -> None:
        self.reader.callback, self.reader.queues = callback, (self.ahead, *others)

    def take_lone(self, run: Any) -> Any:
        return run.taken


def arrivals_of(receiver: Any, *, is_direct: bool = True) -> Arrivals[Any]:
    def on_error(error: Exception) -> None:
        raise error

    return Arrivals(asyncio.get_running_loop(), receiver, on_error, is_direct=is_direct)


async def started(arrivals: Arrivals[Any]) -> asyncio.Task[Any]:
    task = asyncio.create_task(arrivals.wait())
    await asyncio.sleep(0)
    return task


async def test_a_message_is_given_to_the_task_that_waits() -> None:
    receiver = Receiver()
    arrivals = arrivals_of(receiver)
    assert not receiver.reader.arrives("early"), "no task waits"
    task = await started(arrivals)
    assert receiver.reader.arrives("one")
    assert not receiver.reader.arrives("two"), "the task is not back yet"
    assert await task == "one"
    assert not arrivals
    assert not receiver.ahead


async def test_tasks_are_given_messages_in_the_order_in_which_they_began_to_wait() -> None:
    receiver = Receiver()
    arrivals = arrivals_of(receiver)
    tasks = [await started(arrivals) for _ in range(3)]
    for number in range(3):
        assert receiver.reader.arrives(number)
        assert not receiver.reader.arrives("early"), "the task is not back yet"
        assert await tasks[number] == number
    assert not receiver.reader.arrives("late"), "no task waits"


async def test_a_message_may_be_taken_before_its_task_runs() -> None:
    receiver = Receiver()
    arrivals = arrivals_of(receiver)
    task = await started(arrivals)
    receiver.reader.arrives("one")
    assert receiver.ahead.popleft() == "one", "in its place, before what comes later"
    assert await task is None, "it looks again"


async def test_a_message_that_came_alone_by_socket_is_given_too() -> None:
    arrivals = arrivals_of(Receiver())
    run: Any = SimpleNamespace(taken="one")
    assert not arrivals.receive_lone(run), "no task waits"
    task = await started(arrivals)
    assert not arrivals.receive_lone(SimpleNamespace(taken=None)), "it is not simple to take"  # type: ignore[arg-type]
    assert arrivals.receive_lone(run)
    assert await task == "one"


async def test_a_cancelled_task_leaves_the_message_to_the_next() -> None:
    receiver = Receiver()
    arrivals = arrivals_of(receiver)
    first, second = await started(arrivals), await started(arrivals)
    receiver.reader.arrives("one")
    first.cancel()
    with pytest.raises(asyncio.CancelledError):
        await first
    assert [*receiver.ahead] == ["one"]
    assert await second == "one"


async def test_a_task_that_was_cancelled_just_now_is_given_nothing() -> None:
    receiver = Receiver()
    arrivals = arrivals_of(receiver)
    first, second = await started(arrivals), await started(arrivals)
    first.cancel()
    assert receiver.reader.arrives("one")
    assert await second == "one"
    with pytest.raises(asyncio.CancelledError):
        await first


async def test_if_all_tasks_were_cancelled_just_now_the_message_is_taken_next() -> None:
    receiver = Receiver()
    arrivals = arrivals_of(receiver)
    task = await started(arrivals)
    task.cancel()
    assert receiver.reader.arrives("one")
    assert [*receiver.ahead] == ["one"]
    with pytest.raises(asyncio.CancelledError):
        await task
    assert not receiver.reader.arrives("two")


async def test_a_cancelled_task_is_forgotten() -> None:
    receiver = Receiver()
    arrivals = arrivals_of(receiver)
    task = await started(arrivals)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert not arrivals
    assert not receiver.reader.arrives("one")
    assert not receiver.ahead


async def test_a_release_wakes_all_without_a_message() -> None:
    receiver = Receiver()
    arrivals = arrivals_of(receiver)
    tasks = [await started(arrivals) for _ in range(2)]
    arrivals.release()
    assert not receiver.reader.arrives("one"), "no task waits any more"
    assert await asyncio.gather(*tasks) == [None, None]


@pytest.mark.parametrize("is_direct", [True, False])
async def test_tasks_are_only_woken_if_messages_go_elsewhere(is_direct: bool) -> None:
    receiver = Receiver()
    arrivals = arrivals_of(receiver, is_direct=is_direct)
    before = await started(arrivals)
    arrivals.stop_giving()
    after = await started(arrivals)
    assert not receiver.reader.arrives("one")
    assert not arrivals.receive_lone(SimpleNamespace(taken="one"))  # type: ignore[arg-type]
    arrivals.release()
    assert await asyncio.gather(before, after) == [None, None]


async def test_the_end_wakes_all_and_leaves_the_reader() -> None:
    receiver = Receiver()
    arrivals = arrivals_of(receiver)
    task = await started(arrivals)
    arrivals.end()
    assert await task is None
    assert receiver.reader.callback is None


async def test_the_end_leaves_the_reader_even_if_tasks_were_only_woken() -> None:
    receiver = Receiver()
    arrivals = arrivals_of(receiver)
    arrivals.stop_giving()
    arrivals.end()
    assert receiver.reader.callback is None


async def test_a_task_that_is_thrown_away_leaves_the_message_to_the_next() -> None:
    receiver = Receiver()
    arrivals = arrivals_of(receiver)
    thrown = arrivals.wait()
    thrown.send(None)
    second = await started(arrivals)
    receiver.reader.arrives("one")
    thrown.close()
    assert await second == "one"


def test_a_task_may_be_thrown_away_after_its_loop_was_closed() -> None:
    async def begin() -> tuple[Arrivals[Any], Any]:
        arrivals = arrivals_of(Receiver())
        waiting = arrivals.wait()
        waiting.send(None)
        arrivals.receive_lone(SimpleNamespace(taken="one"))  # type: ignore[arg-type]
        return arrivals, waiting

    arrivals, waiting = asyncio.run(begin())
    waiting.close()
    assert not arrivals


def test_a_task_of_another_loop_is_named() -> None:
    async def make() -> Arrivals[Any]:
        return arrivals_of(Receiver())

    async def wait(arrivals: Arrivals[Any]) -> None:
        await arrivals.wait()

    loop = asyncio.new_event_loop()
    try:
        arrivals = loop.run_until_complete(make())
        with pytest.raises(LocalProtocolError, match="another event loop"):
            asyncio.run(wait(arrivals))
    finally:
        loop.close()
