"""Counts the cost of one message for a process: bytecodes, Python calls, allocations, system calls.

The counts do not depend on the load of the machine, so tests use them as bounds. Each count is made in a
separate process, which runs this file. Meanwhile another one publishes or listens, with a pause between
messages. The count is the median of the process's work from one message to the next. It leaves out the event
loop's own Python, and the cost of a publisher's pause.

    assert steps("subscriber").bytecodes <= 40

StepCounter counts the steps of code in a test itself.
"""

import asyncio
import ctypes
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import count, repeat
from pathlib import Path
from statistics import median
from types import CodeType, FrameType
from typing import Any, Literal, NamedTuple, Self, TypeAlias

import pytest

import bus
from bus.msg.std_msgs import String

Role: TypeAlias = Literal["publisher", "subscriber"]

LIMIT_S = 60.0 * float(os.environ.get("BUSD_TESTS_TIMEOUT_FACTOR", "1"))

_MESSAGES = 40
_WARM_UP = 20
_PAUSE_S = 0.005
_TEXT = "x" * 64
_MARK = "/of-no-use/but-to-be-seen-by-strace"
_OTHERS = ("asyncio", "selectors", __name__)

_COUNT_MALLOCS = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stddef.h>
unsigned long allocations;
extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);
void *malloc(size_t size) { allocations++; return __libc_malloc(size); }
void *calloc(size_t count, size_t size) { allocations++; return __libc_calloc(count, size); }
void *realloc(void *old, size_t size) { allocations++; return __libc_realloc(old, size); }
"""


_IS_TOLD_OF_ALL = sys.version_info < (3, 12)
_REASON = "from Python 3.12 on a tracer is not told of every bytecode"
counts_bytecodes = pytest.mark.skipif(not _IS_TOLD_OF_ALL, reason=_REASON)
"""For tests that use StepCounter."""


class Steps(NamedTuple):
    """Steps of Python for one message."""

    bytecodes: float
    calls: float


class StepCounter:
    """Counts bytecodes and Python calls below the code in its block, except the event loop's.

    `also`: code that is counted wherever it runs.
    """

    def __init__(self, also: CodeType | None = None) -> None:
        self.bytecodes = self.calls = 0
        self._also = also
        self._before: Any = None

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self) -> None:
        self._before = sys.gettrace()
        sys.settrace(self._enter)

    def stop(self) -> None:
        sys.settrace(self._before)

    def _enter(self, frame: FrameType, event: str, argument: Any) -> Any:
        is_others = frame.f_globals.get("__name__", "").partition(".")[0] in _OTHERS
        if is_others and frame.f_code is not self._also:
            return None
        self.calls += 1
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        return self._step

    def _step(self, frame: FrameType, event: str, argument: Any) -> Any:
        self.bytecodes += event == "opcode"
        return self._step


def steps(role: Role, loop: str = "uvloop", **options: bool) -> Steps:
    """The steps of a publisher, or of a subscriber with a plain callback, for a message of 64 characters.

    `loop`: uvloop, asyncio, rclpy (it spins), or none: the API for scripts, in which a subscriber iterates.
    `options`: as `_listen` and `_listen_without_loop` take them. Skips as `counts_bytecodes` does.
    """
    if not _IS_TOLD_OF_ALL:
        pytest.skip(_REASON)
    counted = _measure(role, [], {}, unit="steps", loop=loop, **options)
    bytecodes, calls = (_of_one(role, list(row)) for row in zip(*counted, strict=True))
    return Steps(bytecodes, calls)


def allocations(role: Role, folder: Path, loop: str = "uvloop", **options: bool) -> float:
    """Calls of malloc, calloc and realloc; each of Python's objects is made by such a call.

    Skips the test without a C compiler or glibc.
    """
    library, source = folder / "count_mallocs.so", folder / "count_mallocs.c"
    source.write_text(_COUNT_MALLOCS)
    compiler = shutil.which("cc") or pytest.skip(
        "allocations are counted by a library: there is no C compiler"
    )
    built = subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", library, source], capture_output=True)
    variables = {"LD_PRELOAD": str(library), "PYTHONMALLOC": "malloc"}
    tried = subprocess.run([sys.executable, "-c", "0"], env={**os.environ, **variables}, capture_output=True)
    if built.returncode or tried.returncode or tried.stderr:
        pytest.skip(f"allocations can't be counted here: {(built.stderr or tried.stderr).decode()}")
    return _of_one(role, _measure(role, [], variables, unit="allocations", loop=loop, **options))


def system_calls(role: Role, folder: Path, loop: str = "uvloop", **options: bool) -> float:
    """System calls, including the wait for the next message. Skips the test if strace is not allowed."""
    strace = shutil.which("strace") or pytest.skip("system calls are counted by strace, which is not there")
    log = folder / "strace.log"
    command = [strace, "-qq", "-o", str(log)]
    tried = subprocess.run([*command, sys.executable, "-c", "0"], capture_output=True, text=True)
    if tried.returncode:
        pytest.skip(f"strace may not look: {tried.stderr}")
    _measure(role, command, {}, unit="system_calls", loop=loop, **options)
    counts, since = list[int](), 0
    for line in log.read_text().splitlines():
        since += 1
        if _MARK in line:
            counts.append(since - 1)
            since = 0
    if role == "subscriber":  # under load some arrive together with the previous one, without a system call
        return median(filter(None, counts[1:]))
    return _of_one(role, counts[1:])


def _of_one(role: Role, counts: list[int]) -> float:
    return median(counts) if role == "subscriber" else median(counts[0::2]) - median(counts[1::2])


def _measure(role: Role, before: list[str], variables: dict[str, str], **options: Any) -> Any:
    """The output of the program."""
    other = "subscriber" if role == "publisher" else "publisher"
    with (
        _program(other, [], {}, unit="nothing", loop="uvloop"),
        _program(role, before, variables, **options) as measured,
    ):
        said, _ = measured.communicate(timeout=LIMIT_S)
    assert measured.returncode == 0
    return json.loads(said)


@contextmanager
def _program(
    role: str, before: list[str], variables: dict[str, str], **options: Any
) -> Iterator[subprocess.Popen[str]]:
    command = [*before, sys.executable, __file__, role, json.dumps(options)]
    environment = {**os.environ, "PYTHONASYNCIODEBUG": "", **variables}
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            yield process
        finally:
            with suppress(ProcessLookupError):  # it has ended
                os.killpg(process.pid, signal.SIGKILL)


# --- in the measured process


class _Meter:
    """Measures nothing, without an end."""

    is_endless = True

    def mark(self) -> None:
        """Mark the end of one message and the start of the next."""

    def counts(self) -> list[Any]:
        """The counts between two marks."""
        return []


class _StepCount(_Meter):
    """`code` belongs to the user's callback; its steps count, too."""

    is_endless = False

    def __init__(self, code: CodeType | None) -> None:
        self._counter = StepCounter(code)
        self._counts: list[tuple[int, int]] = []

    def mark(self) -> None:
        counter = self._counter
        if not self._counts:
            counter.start()
        self._counts.append((counter.bytecodes, counter.calls))
        counter.bytecodes = counter.calls = 0

    def counts(self) -> list[Any]:
        self._counter.stop()
        return self._counts[1:]


class _AllocationCount(_Meter):
    is_endless = False

    def __init__(self) -> None:
        self._count = ctypes.c_ulong.in_dll(ctypes.CDLL(None), "allocations")
        self._seen = [0] * (2 * _MESSAGES + 2)
        self._at = 0

    def mark(self) -> None:
        self._seen[self._at] = self._count.value
        self._seen[self._at + 1] = self._count.value  # the cost of a mark itself
        self._at += 2

    def counts(self) -> list[Any]:
        own = min(self._seen[at + 1] - self._seen[at] for at in range(0, self._at, 2))
        return [self._seen[at] - self._seen[at - 1] - own for at in range(2, self._at, 2)]


class _SystemCallCount(_Meter):
    """Leaves counting to strace."""

    is_endless = False

    def mark(self) -> None:
        os.access(_MARK, 0)


def _meter(unit: str, code: CodeType | None = None) -> _Meter:
    match unit:
        case "steps":
            return _StepCount(code)
        case "allocations":
            return _AllocationCount()
        case "system_calls":
            return _SystemCallCount()
    return _Meter()


async def _listen(unit: str, *, message_lost: bool = False) -> list[Any]:
    """`message_lost`: with a callback for losses."""
    heard = 0
    is_done = asyncio.get_running_loop().create_future()

    def callback(message: String) -> None:
        nonlocal heard
        heard += 1

    def counted(message: String) -> None:
        callback(message)
        if is_done.done():
            return  # further messages of the same batch
        if heard >= _WARM_UP:
            meter.mark()
        if heard == _WARM_UP + _MESSAGES and not meter.is_endless:
            is_done.set_result(meter.counts())

    meter = _meter(unit, callback.__code__)
    events = bus.SubscriptionEvents(message_lost=id) if message_lost else None
    async with bus.Node("listener", rosout=False, arguments=[]) as node:
        await node.create_subscription(String, "steps", 10, counted, events=events)
        counts: list[Any] = await is_done
        return counts


def _listen_without_loop(unit: str, *, with_info: bool = False) -> list[Any]:
    """`with_info`: with `receive`."""
    meter = _meter(unit)
    with bus.connect("listener", rosout=False, arguments=[]) as node:
        subscription = node.create_subscription(String, "steps", 10)
        messages = (subscription.receive() for _ in repeat(None)) if with_info else subscription
        for heard, _ in enumerate(messages, 1):
            if heard >= _WARM_UP:
                meter.mark()
            if heard == _WARM_UP + _MESSAGES and not meter.is_endless:
                return meter.counts()
    raise AssertionError("it never ends")


def _listen_in_executor(unit: str, *, threads: bool = False) -> list[Any]:
    """Without the steps of `Executor.spin` itself, which began earlier. `threads`: one of two is counted."""
    import bus_ros.rclpy as rclpy  # has its own signals and threads
    from bus_ros.rclpy.executors import MultiThreadedExecutor

    heard = 0

    def callback(message: Any) -> None:
        nonlocal heard
        heard += 1
        if heard >= _WARM_UP:
            meter.mark()
        if heard == _WARM_UP + _MESSAGES and not meter.is_endless:
            counts.extend(meter.counts())
            rclpy.shutdown()

    meter, counts = _meter(unit), list[Any]()
    with rclpy.init(args=[]):
        node = rclpy.create_node("listener", enable_rosout=False)
        node.create_subscription(String, "steps", callback, 10)
        rclpy.spin(node, MultiThreadedExecutor(2) if threads else None)
    return counts


def _publish_without_loop(unit: str) -> list[Any]:
    """Publish, as `_publish` does."""
    meter, message = _meter(unit), String(data=_TEXT)
    with bus.connect("talker", rosout=False, arguments=[]) as node:
        publisher = node.create_publisher(String, "steps", 10)
        publisher.wait_for_subscriptions(1)
        for turn in count():
            if turn >= _WARM_UP:
                meter.mark()
            if turn == _WARM_UP + _MESSAGES and not meter.is_endless:
                return meter.counts()
            if turn % 2 == 0:
                publisher.publish(message)
            time.sleep(_PAUSE_S)
    raise AssertionError("it never ends")


async def _publish(unit: str) -> list[Any]:
    """Alternate a message with a pause, and a pause alone."""
    meter, message = _meter(unit), String(data=_TEXT)
    async with bus.Node("talker", rosout=False, arguments=[]) as node:
        publisher = await node.create_publisher(String, "steps", 10)
        await publisher.wait_for_subscriptions(1)
        turn = 0
        while True:
            if turn >= _WARM_UP:
                meter.mark()
            if turn == _WARM_UP + _MESSAGES and not meter.is_endless:
                return meter.counts()
            if turn % 2 == 0:
                publisher.publish(message)
            await asyncio.sleep(_PAUSE_S)
            turn += 1


def _main() -> None:
    role, text = sys.argv[1:]
    options = json.loads(text)
    loop = options.pop("loop")
    if loop == "rclpy":
        print(json.dumps(_listen_in_executor(**options)))
        return
    if loop == "none":
        run = _publish_without_loop if role == "publisher" else _listen_without_loop
        print(json.dumps(run(**options)))
        return
    if loop == "uvloop":
        import uvloop

        factory: Callable[[], asyncio.AbstractEventLoop] = uvloop.new_event_loop
    else:
        factory = asyncio.new_event_loop
    with asyncio.Runner(loop_factory=factory) as runner:
        print(json.dumps(runner.run((_publish if role == "publisher" else _listen)(**options))))


if __name__ == "__main__":
    _main()
