"""Waiting for the start, the output and the end of a process.

`context` is the fixture `launch_context`, `action` the ExecuteProcess, with `cached_output=True` for output.
`timeout` is in seconds; None: no limit. Functions with `_sync` are for tests that are not coroutines.

`wait_for_...` returns whether it has happened. A process that started or ended before the call counts, too.
(In ROS 2 only events after the call count.) `assert_...` raises the AssertionError of its `validate_output`
if that still fails at the end.
"""

import asyncio
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from bus_launch.launch.core import BaseEventHandler, Event, LaunchContext
from bus_launch.launch.events.process import RunningProcessEvent

__all__ = [
    "assert_output",
    "assert_output_sync",
    "assert_stderr",
    "assert_stderr_sync",
    "wait_for_exit",
    "wait_for_exit_sync",
    "wait_for_output",
    "wait_for_output_sync",
    "wait_for_start",
    "wait_for_start_sync",
    "wait_for_stderr",
    "wait_for_stderr_sync",
]

Validate = Callable[[str], Any]
_Met = Callable[[], Any]


async def wait_for_start(context: LaunchContext, action: Any, timeout: float | None = None) -> Any:
    return await _wait(context, action, lambda: action.process_details is not None, timeout)


def wait_for_start_sync(context: LaunchContext, action: Any, timeout: float | None = None) -> Any:
    return _wait_sync(context, action, lambda: action.process_details is not None, timeout)


async def wait_for_exit(context: LaunchContext, action: Any, timeout: float | None = None) -> Any:
    return await _wait(context, action, lambda: action.return_code is not None, timeout)


def wait_for_exit_sync(context: LaunchContext, action: Any, timeout: float | None = None) -> Any:
    return _wait_sync(context, action, lambda: action.return_code is not None, timeout)


async def wait_for_output(
    context: LaunchContext, action: Any, validate_output: Validate, timeout: float | None = None
) -> Any:
    return await _wait(context, action, lambda: validate_output(action.get_stdout()), timeout)


def wait_for_output_sync(
    context: LaunchContext, action: Any, validate_output: Validate, timeout: float | None = None
) -> Any:
    return _wait_sync(context, action, lambda: validate_output(action.get_stdout()), timeout)


async def wait_for_stderr(
    context: LaunchContext, action: Any, validate_output: Validate, timeout: float | None = None
) -> Any:
    return await _wait(context, action, lambda: validate_output(action.get_stderr()), timeout)


def wait_for_stderr_sync(
    context: LaunchContext, action: Any, validate_output: Validate, timeout: float | None = None
) -> Any:
    return _wait_sync(context, action, lambda: validate_output(action.get_stderr()), timeout)


async def assert_output(
    context: LaunchContext, action: Any, validate_output: Validate, timeout: float | None = None
) -> None:
    if not await _wait(context, action, _passes(validate_output, action.get_stdout), timeout):
        validate_output(action.get_stdout())


def assert_output_sync(
    context: LaunchContext, action: Any, validate_output: Validate, timeout: float | None = None
) -> None:
    if not _wait_sync(context, action, _passes(validate_output, action.get_stdout), timeout):
        validate_output(action.get_stdout())


async def assert_stderr(
    context: LaunchContext, action: Any, validate_output: Validate, timeout: float | None = None
) -> None:
    if not await _wait(context, action, _passes(validate_output, action.get_stderr), timeout):
        validate_output(action.get_stderr())


def assert_stderr_sync(
    context: LaunchContext, action: Any, validate_output: Validate, timeout: float | None = None
) -> None:
    if not _wait_sync(context, action, _passes(validate_output, action.get_stderr), timeout):
        validate_output(action.get_stderr())


def _passes(validate_output: Validate, read: Callable[[], str]) -> _Met:
    def passes() -> bool:
        try:
            validate_output(read())
        except AssertionError:
            return False
        return True

    return passes


class _Watch(BaseEventHandler):
    """Calls a function at each event of a process, and has no part in the launch otherwise."""

    def __init__(self, action: Any, call: Callable[[], object]) -> None:
        super().__init__(matcher=self._takes)
        self._action = action
        self._call = call

    def _takes(self, event: Event) -> bool:
        return isinstance(event, RunningProcessEvent) and event.action is self._action

    def handle(self, event: Event, context: LaunchContext) -> None:
        self._call()


@contextmanager
def _watched(context: LaunchContext, action: Any, call: Callable[[], object]) -> Iterator[None]:
    handler = _Watch(action, call)
    context.register_event_handler(handler, append=True)
    try:
        yield
    finally:
        context.unregister_event_handler(handler)


async def _wait(context: LaunchContext, action: Any, is_met: _Met, timeout: float | None) -> Any:
    news = asyncio.Event()
    with _watched(context, action, news.set):
        try:
            async with asyncio.timeout(timeout):
                while not (found := is_met()):
                    await news.wait()
                    news.clear()
                return found
        except TimeoutError:
            return is_met()


def _wait_sync(context: LaunchContext, action: Any, is_met: _Met, timeout: float | None) -> Any:
    news = threading.Event()
    end_s = None if timeout is None else time.monotonic() + timeout
    with _watched(context, action, news.set):
        while not (found := is_met()):
            left_s = None if end_s is None else end_s - time.monotonic()
            if left_s is not None and left_s <= 0:
                break
            news.wait(left_s)
            news.clear()
        return found
