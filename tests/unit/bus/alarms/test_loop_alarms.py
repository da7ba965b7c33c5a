"""bus.alarms: timed calls on an event loop, by a kernel timer and by the event loop's own timers."""

import asyncio
import contextvars
import errno
import os
from collections.abc import AsyncIterator, Callable
from time import monotonic_ns
from unittest.mock import Mock

import pytest

from bus.alarms import Alarms, wake_up
from bus.alarms.schedule import NEVER_NS
from bus.alarms.wake_up import KernelWakeUp, LoopWakeUp
from conftest import open_descriptors

pytestmark = pytest.mark.both_loops

MS = 1_000_000
FAR_NS = 3_600_000 * MS


class Rung:
    """An event loop's wake-up. It records the times that it is set to, and a test rings it."""

    def __init__(self, loop: asyncio.AbstractEventLoop, ring: Callable[[], object]) -> None:
        self.ring = ring
        self.times: list[int] = []
        self.set = self.times.append
        self.close = self.abandon = lambda: None


@pytest.fixture(params=["kernel", "loop"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> type:
    if request.param == "loop":
        monkeypatch.setattr(wake_up, "has_kernel_timer", lambda: False)
        return LoopWakeUp
    if not wake_up.has_kernel_timer():
        pytest.skip("neither this Python nor the native core has a timer of the kernel")
    return KernelWakeUp


@pytest.fixture
async def alarms(way: type) -> AsyncIterator[Alarms]:
    made = Alarms.acquire(asyncio.get_running_loop())
    assert type(made._wake_up) is way
    yield made
    made.release()


async def test_calls_come_in_the_order_of_their_times_and_not_before(alarms: Alarms) -> None:
    begin_ns, came, done = monotonic_ns(), list[tuple[int, int]](), asyncio.Event()
    for delay_ms in (3, 0, 2, -5, 1):
        due_ns = begin_ns + delay_ms * MS
        alarms.add(due_ns, lambda due_ns=due_ns: came.append((due_ns, monotonic_ns())))
    alarms.add(begin_ns + 4 * MS, done.set)
    assert not came
    await done.wait()
    assert [due_ns for due_ns, _ in came] == [begin_ns + ms * MS for ms in (-5, 0, 1, 2, 3)]
    assert all(due_ns <= came_ns for due_ns, came_ns in came)


async def test_it_is_quiet_once_all_have_been_called(alarms: Alarms, monkeypatch: pytest.MonkeyPatch) -> None:
    done = asyncio.Event()
    alarms.add(monotonic_ns(), done.set)
    await done.wait()
    look = Mock(side_effect=alarms._schedule.due)
    monkeypatch.setattr(alarms._schedule, "due", look)
    for _ in range(10):
        await asyncio.sleep(0)
    await asyncio.sleep(0.002)
    look.assert_not_called()


async def test_a_call_has_the_context_in_which_it_was_added(alarms: Alarms) -> None:
    name = contextvars.ContextVar[str]("name")
    seen, done = list[str](), asyncio.Event()

    async def add(value: str) -> None:
        name.set(value)
        alarms.add(monotonic_ns(), lambda: seen.append(name.get()))

    await asyncio.gather(add("first"), add("second"))
    alarms.add(monotonic_ns() + MS, done.set)
    await done.wait()
    assert seen == ["first", "second"]


async def test_an_exception_goes_to_the_event_loop_and_the_other_calls_come(alarms: Alarms) -> None:
    handled, done = list[object](), asyncio.Event()
    asyncio.get_running_loop().set_exception_handler(lambda _, found: handled.append(found["exception"]))
    alarms.add(monotonic_ns(), lambda: 1 // 0)
    alarms.add(monotonic_ns(), done.set)
    await done.wait()
    assert [type(one) for one in handled] == [ZeroDivisionError]


async def test_a_callback_releases_the_last_use(way: type) -> None:
    alarms, done = Alarms.acquire(asyncio.get_running_loop()), asyncio.Event()

    def end() -> None:
        alarms.release()
        done.set()

    alarms.add(monotonic_ns(), end)
    await done.wait()
    alarms.add(monotonic_ns(), lambda: 1 // 0)  # is never called
    again = Alarms.acquire(asyncio.get_running_loop())
    assert again is not alarms
    again.release()


async def test_one_descriptor_for_a_loop_until_the_last_release() -> None:
    loop, before = asyncio.get_running_loop(), len(open_descriptors())
    users = [Alarms.acquire(loop) for _ in range(3)]
    assert len(set(map(id, users))) == 1
    for one in users:
        assert len(open_descriptors()) == before + wake_up.has_kernel_timer()
        one.release()
    assert len(open_descriptors()) == before


def test_a_loop_that_is_closed_first() -> None:
    loop = asyncio.new_event_loop()
    alarms = Alarms.acquire(loop)
    alarms.add(monotonic_ns() + FAR_NS, print)
    loop.close()
    alarms.release()


async def test_without_a_descriptor_the_loop_s_timers_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def create() -> int:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    monkeypatch.setattr(wake_up, "has_kernel_timer", lambda: True)
    monkeypatch.setattr(wake_up, "_system_calls", lambda: (create, print))
    alarms, done = Alarms.acquire(asyncio.get_running_loop()), asyncio.Event()
    alarms.add(monotonic_ns(), done.set)
    await done.wait()
    alarms.release()


async def test_the_wake_up_is_set_only_where_the_earliest_alarm_changes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("bus.alarms.loop_alarms.make_wake_up", Rung)
    alarms = Alarms.acquire(asyncio.get_running_loop())
    rung = alarms._wake_up
    assert isinstance(rung, Rung)
    now_ns = monotonic_ns()
    far = alarms.add(now_ns + FAR_NS, print)
    for _ in range(10_000):
        alarms.add(now_ns + 2 * FAR_NS, print)
    assert rung.times == [now_ns + FAR_NS]
    far.cancel()
    alarms.add(now_ns + FAR_NS, print)  # a reset: the wake-up is set to that time already
    assert rung.times == [now_ns + FAR_NS]
    rung.times.clear()
    left = 3

    def again() -> None:
        nonlocal left
        left -= 1
        if left:
            alarms.add(now_ns, again)

    alarms.add(now_ns, again)
    for _ in range(left):
        rung.ring()
    first, *others, last = rung.times
    assert (first, len(others), last) == (now_ns, 2, now_ns + FAR_NS)  # one system call for each call
    alarms.release()


@pytest.mark.skipif(not wake_up.has_kernel_timer(), reason="needs a timer of the kernel")
async def test_a_child_does_not_touch_the_timer_of_its_parent() -> None:
    loop, done = asyncio.get_running_loop(), asyncio.Event()
    alarms = Alarms.acquire(loop)
    alarm = alarms.add(monotonic_ns() + FAR_NS, print)
    alarms.add(monotonic_ns() + 20 * MS, done.set)
    if not (pid := os.fork()):
        try:
            alarm.cancel()
            alarms.add(0, print)  # if the child set the timer to 0, the parent's timer would fire at once
            alarms.add(NEVER_NS, print)
            alarms.release()
            is_sane = Alarms.acquire(loop) is not alarms and not done.is_set()
        finally:
            os._exit(0 if is_sane else 1)
    assert os.waitpid(pid, 0)[1] == 0  # noqa: ASYNC222
    await done.wait()
    alarms.release()
