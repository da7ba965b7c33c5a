"""bus.delivery.dispatcher: a run that arrives alone goes to the callback at once, if nothing forbids it."""

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from bus.delivery.dispatcher import Dispatcher
from bus.delivery.receiver import Receiver
from bus.delivery.sequence import PublisherProxy
from bus.shm import has_core
from bus.wire.runs import Run
from feeding import frame_record
from semantics import until

pytestmark = pytest.mark.skipif(not has_core(), reason="the native core was not built")


class World:
    """A receiver and its dispatcher, as the link uses them."""

    def __init__(self, callback: Callable[..., Any] | None = None) -> None:
        self.heard: list[int] = []
        self.errors: list[BaseException] = []
        self.act: Callable[[int], object] = int
        self.receiver: Receiver[int] = Receiver(
            lambda payload: int(bytes(payload)),
            10,
            is_lossless=False,
            on_drop=lambda reason, count: None,
            on_reject=lambda size, error: self.errors.append(error),
            on_taken=lambda source: None,
        )
        source = self.receiver.tracker[1] = PublisherProxy(1, b"1" * 16, 0, 0, needs_ack=False)
        source.is_new = False
        self.seq = 0
        loop = asyncio.get_running_loop()
        port: Any = SimpleNamespace(
            soon=loop.call_soon, start=lambda work, name: loop.create_task(work, name=name).cancel
        )
        self.dispatcher: Dispatcher[int] = Dispatcher(
            port,
            callback or self.call,
            self.receiver,
            make_info=lambda taken: "info",
            receive=self.receive,
            on_error=self.errors.append,
            name="t",
            is_timed=False,
        )

    async def receive(self) -> Any:
        await asyncio.Future()

    def call(self, number: int) -> None:
        self.heard.append(number)
        self.act(number)

    def run(self, *numbers: int) -> Run:
        """The next run."""
        first_seq, self.seq = self.seq + 1, self.seq + len(numbers)
        return Run(1, 1, first_seq, len(numbers), b"".join(frame_record(b"%d" % one, 1) for one in numbers))

    def arrive(self, *numbers: int) -> bool:
        """True if the run went the quick way. Otherwise it is queued and dispatched."""
        run = self.run(*numbers)
        if self.dispatcher.is_plain and self.dispatcher.deliver(run):
            return True
        self.receiver.put(run)
        self.dispatcher.dispatch()
        return False


async def test_one_that_is_alone_is_called_back_for_at_once() -> None:
    world = World()
    assert world.arrive(1) and not world.arrive(2, 3) and world.arrive(4)
    assert (world.heard, world.receiver.delivered, world.receiver.queued) == ([1, 2, 3, 4], 4, 0)


async def test_what_an_exception_leaves_waits_and_is_not_overtaken() -> None:
    world = World()

    def fail(number: int) -> None:
        raise RuntimeError(number)

    world.act = fail
    assert world.arrive(1)
    assert [str(error) for error in world.errors] == ["1"]
    world.receiver.put(world.run(2, 3))
    world.act = int
    assert not world.arrive(4)
    assert (world.heard, world.errors[1:]) == ([1, 2, 3, 4], [])


@pytest.mark.parametrize("error", [SystemExit, KeyboardInterrupt])
async def test_what_ends_the_program_goes_through_and_the_next_is_heard(error: type[BaseException]) -> None:
    world = World()

    def leave(number: int) -> None:
        raise error

    world.act = leave
    with pytest.raises(error):
        world.arrive(1)
    world.act = int
    assert world.arrive(2)
    assert (world.heard, world.errors) == ([1, 2], [])


async def test_what_comes_during_a_call_is_delivered_after_it() -> None:
    world = World()
    calls = []

    def nest(number: int) -> None:
        calls.append(number)
        if number == 1:
            assert not world.arrive(2)
            assert not world.arrive(3, 4)
            assert world.heard == [1]

    world.act = nest
    assert world.arrive(1)
    await until(lambda: len(calls) == 4)  # on a busy machine, this takes more than one turn of the loop
    assert world.heard == calls == [1, 2, 3, 4]


async def test_one_that_ends_itself_hears_no_more() -> None:
    world = World()

    def end(number: int) -> None:
        world.dispatcher.end()
        world.receiver.put(world.run(2))

    world.act = end
    assert world.arrive(1)
    assert not world.arrive(3)
    assert world.heard == [1]


async def test_one_that_does_not_decode_is_counted_and_told_of_once() -> None:
    world = World()
    body = frame_record(b"x", 1)
    run = Run(1, 1, 1, 1, body)
    assert not world.dispatcher.deliver(run)
    world.receiver.put(run)
    world.dispatcher.dispatch()
    assert (world.heard, len(world.errors), world.receiver.dropped) == ([], 1, {"undecodable": 1})


async def test_a_callback_that_wants_info_or_is_async_is_not_plain() -> None:
    def with_info(message: int, info: str) -> None: ...

    async def wait(message: int) -> None: ...

    for callback in (with_info, wait):
        world = World(callback)
        assert not world.dispatcher.is_plain
        world.dispatcher.end()
