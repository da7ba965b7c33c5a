"""Callbacks that block the event loop, on a clock of the test: calls that count, and the one warning."""

from collections.abc import Awaitable, Callable, Generator
from typing import Any

import pytest

from bus.diagnostics import slow_callback
from bus.diagnostics.slow_callback import SLOW_NS, SlowWatch, timed_by_caller, watched


class Clock:
    def __init__(self) -> None:
        self.now_ns = 0

    def pass_(self, ns: int = SLOW_NS) -> None:
        self.now_ns += ns


class Log:
    """A node's log."""

    def __init__(self, name: str = "robot.camera") -> None:
        self.name = name
        self.warnings: list[str] = []

    def warning(self, text: str) -> None:
        self.warnings.append(text)


class Turn:
    """Awaited: one turn of the event loop."""

    def __await__(self) -> Generator[str, Any, Any]:
        return (yield "turn")


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(slow_callback, "monotonic_ns", lambda: made.now_ns)
    return made


def watch(callback: Callable[..., Any], log: Log) -> Callable[..., Any]:
    logger: Any = log
    return watched(callback, "timer", logger)


def test_a_plain_callback(clock: Clock) -> None:
    log = Log()

    def work(ns: int) -> int:
        clock.pass_(ns)
        return ns

    call = watch(work, log)
    assert call(SLOW_NS - 1) == SLOW_NS - 1
    assert log.warnings == []
    assert [call(SLOW_NS), call(5 * SLOW_NS)] == [SLOW_NS, 5 * SLOW_NS]
    (text,) = log.warnings
    assert "work (" in text
    assert "of timer held up the event loop for 200 ms" in text
    assert text.endswith("(said once)")


def test_one_that_raises_counts_too(clock: Clock) -> None:
    log = Log()

    def fail() -> None:
        clock.pass_()
        raise ValueError

    with pytest.raises(ValueError):
        watch(fail, log)()
    assert len(log.warnings) == 1


async def wait_for(work: Awaitable[Any]) -> Any:
    return await work


def drive(work: Awaitable[Any], between: Callable[[], object]) -> Any:
    """Run it as an event loop does; `between` runs while it awaits."""
    running = wait_for(work).__await__()
    sent: Any = None
    while True:
        try:
            running.send(sent)
        except StopIteration as end:
            return end.value
        between()
        sent = "back"


async def wait_only() -> Any:
    return await Turn()


def test_time_that_an_async_callback_awaits_is_the_others(clock: Clock) -> None:
    log = Log()
    assert drive(watch(wait_only, log)(), clock.pass_) == "back"
    assert log.warnings == []


@pytest.mark.parametrize("part", ["first", "middle", "last"])
def test_each_part_of_an_async_callback_counts(clock: Clock, part: str) -> None:
    log = Log()

    async def work() -> str:
        for now in ("first", "middle", "last"):
            if now == part:
                clock.pass_()
            if now != "last":
                await Turn()
        return "done"

    assert drive(watch(work, log)(), lambda: None) == "done"
    assert len(log.warnings) == 1


def test_an_error_while_it_awaits_reaches_it(clock: Clock) -> None:
    log, seen = Log(), []

    async def work() -> str:
        try:
            await Turn()
        except TimeoutError as error:
            seen.append(error)
            clock.pass_()
        return "mended"

    running = wait_for(watch(work, log)()).__await__()
    running.send(None)
    with pytest.raises(StopIteration, match="mended"):
        running.throw(TimeoutError())
    assert len(seen) == len(log.warnings) == 1


def test_the_user_of_a_tool_is_not_told() -> None:
    """He has no callback that he could change."""
    for name, count in (("_ros2cli_7", 0), ("tools._hidden", 0), ("tools.shown", 1)):
        log: Any = Log(name)
        SlowWatch(print, "subscription '/t'", log).note(SLOW_NS)
        assert len(log.warnings) == count, name


def test_for_a_caller_that_has_the_times() -> None:
    log: Any = Log()
    callback, note = timed_by_caller(print, "subscription '/t'", log)
    assert callback is print
    assert note is not None
    note(SLOW_NS)
    assert "callback print of subscription '/t'" in log.warnings[0]
    callback, note = timed_by_caller(wait_only, "subscription '/t'", log)
    assert callback is not wait_only and note is None


def test_the_name_of_a_bound_callback(clock: Clock) -> None:
    log = Log()

    class Camera:
        def on_image(self) -> None:
            clock.pass_()

    watch(Camera().on_image, log)()
    assert "Camera.on_image" in log.warnings[0]
