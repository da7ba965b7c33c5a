"""A recording as a program: signals that end it, keys, the line on the terminal, and the report at the
end."""

import asyncio
import gc
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from time import monotonic_ns

from bus.node import Node
from bus.runner import loop_factory
from bus.transport.memory import keep_freed_memory
from bus_bag.errors import BagError
from bus_bag.losses import TopicLosses, lines
from bus_bag.record.options import RecordOptions
from bus_bag.record.progress import Progress
from bus_bag.record.recorder import Recorder
from bus_bag.terminal.keyboard import Keyboard
from bus_bag.terminal.status_line import StatusLine

__all__ = ["run", "settle_process"]

_ALLOCATIONS = 50_000
_SPACE = b" "
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def run(options: RecordOptions, open_node: Callable[[], Node]) -> int:
    """Record until Ctrl-C, SIGTERM, or a full disk; returns the exit code.

    A second Ctrl-C drops messages that still wait for the file. Raises BagError, OSError and
    ConfigurationError if the recording can't begin, and BagError if it has failed; its text describes the
    contents of the bag.
    """
    settle_process()
    try:
        with asyncio.Runner(loop_factory=loop_factory()) as runner:
            return runner.run(_record(options, open_node))
    finally:
        _set_policy("SCHED_OTHER")


def settle_process() -> None:
    """Tune this process for recording: it allocates and frees memory all the time."""
    keep_freed_memory()  # chunks are allocated and freed all the time
    # Hundreds of thousands of messages are made and freed, and none is in a cycle. The usual search for
    # cycles would take a fifth of the time.
    gc.freeze()
    gc.set_threshold(_ALLOCATIONS)
    _set_policy("SCHED_BATCH")  # a message does not take its publisher's CPU away


def _set_policy(name: str) -> None:
    """Set the kernel's scheduling policy for this thread and for threads that it starts (Linux only)."""
    if sys.platform == "linux":
        with suppress(OSError):
            os.sched_setscheduler(0, getattr(os, name), os.sched_param(0))


async def _record(options: RecordOptions, open_node: Callable[[], Node]) -> int:
    line = StatusLine()
    async with open_node() as node:
        recorder = Recorder(node, options)
        with _ended_by_signals(recorder.stop):
            keyboard = None
            showing = asyncio.create_task(_show(recorder, line, options.progress_hz))
            try:
                if options.has_keys and Keyboard.is_there():
                    keyboard = Keyboard(lambda keys: _press(recorder, keys), line.erase)
                    node.get_logger().info("Press SPACE for pausing/resuming")
                losses = await recorder.run()
            finally:
                showing.cancel()
                line.close()
                if keyboard is not None:
                    keyboard.close()
        _log_losses(node, losses)
    if recorder.failure is not None:
        raise BagError(f"{recorder.failure}; the bag has all earlier messages")
    return 0


@contextmanager
def _ended_by_signals(end: Callable[[], None]) -> Iterator[None]:
    """Call `end` at signals that end a program, among them SIGHUP of a closed terminal, except under nohup.

    A shell script lets its background programs ignore SIGINT. `kill -INT` still ends a recorder there, as it
    ends the recorder of ROS 2.
    """
    loop = asyncio.get_running_loop()
    is_kept = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    numbers = [one for one in _ENDING if one != signal.SIGHUP or not is_kept]
    for number in numbers:
        loop.add_signal_handler(number, end)
    try:
        yield
    finally:
        for number in numbers:
            loop.remove_signal_handler(number)


def _press(recorder: Recorder, keys: bytes) -> None:
    for _ in range(keys.count(_SPACE)):
        recorder.toggle_paused()


async def _show(recorder: Recorder, line: StatusLine, hz: float) -> None:
    if not line.is_shown or hz <= 0:
        return
    progress = Progress(monotonic_ns())
    while True:
        pipeline = recorder.pipeline
        text = progress.line(
            monotonic_ns(),
            pipeline.messages,
            pipeline.written_bytes,
            pipeline.cached,
            recorder.lost(),
            is_paused=recorder.is_paused,
        )
        line.show(text)
        await asyncio.sleep(1 / hz)


def _log_losses(node: Node, losses: dict[str, TopicLosses]) -> None:
    log = node.get_logger()
    if lost := "".join(f"\n\t{one}" for one in lines(losses)):
        total = sum(sum(one.lost.values()) for one in losses.values())
        log.warning(f"Messages lost per topic: {lost}\nTotal lost: {total}")
    log.info("Recording stopped")
