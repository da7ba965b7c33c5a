"""A well-behaved pair that exchanges messages while a test misuses their broker: all must arrive.

    with Neighbours(path) as neighbours:
        ...                         the misuse
        neighbours.carry_on()       waits until more messages have arrived

They run in a thread with its own event loop: a test may block. Leaving checks that nothing was lost, repeated
or reordered, and that the broker never closed their connection.
"""

import asyncio
import contextlib
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

import pytest

import bus
from bus.msg.std_msgs import Int64
from bus.runner import loop_factory
from conftest import WAIT_S
from semantics import until

PERIOD_S = 0.005
_DEPTH = 2000


class Neighbours:
    """One node with a publisher and a subscription, on the broker at `path`."""

    def __init__(self, path: Path) -> None:
        self.heard: list[int] = []
        self.sent = 0
        self._path = path
        self._ready = threading.Event()
        self._leave = threading.Event()
        self._error: BaseException | None = None
        self._dropped: dict[str, int] = {}
        self._was_cut_off = False
        self._thread = threading.Thread(target=self._run, name="neighbours")

    def __enter__(self) -> Self:
        self._thread.start()
        self._ready.wait(WAIT_S)
        self._raise()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._leave.set()
        self._thread.join()
        if error is None:
            self._raise()
            assert self.heard == list(range(self.sent)), "the neighbours lost messages"
            assert not self._dropped
            assert not self._was_cut_off, "the broker cut the neighbours off"

    def carry_on(self, messages: int = 10) -> None:
        """Wait until `messages` more messages have arrived."""
        goal = self.sent + messages
        wait_until(lambda: len(self.heard) >= goal or self._error is not None)
        self._raise()

    def _raise(self) -> None:
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        try:
            with asyncio.Runner(loop_factory=loop_factory()) as runner:
                runner.run(self._talk())
        except BaseException as error:
            self._error = error
        finally:
            self._ready.set()

    async def _talk(self) -> None:
        async with bus.Node("neighbour", arguments=[], rosout=False, socket=self._path) as node:
            subscription = await node.create_subscription(
                Int64, "/good/talk", _DEPTH, lambda message: self.heard.append(message.data)
            )
            publisher = await node.create_publisher(Int64, "/good/talk", _DEPTH)
            ids = publisher._core.id, subscription._core.id
            self._ready.set()
            while not self._leave.is_set():
                publisher.publish(Int64(data=self.sent))
                self.sent += 1
                await asyncio.sleep(PERIOD_S)
            with contextlib.suppress(TimeoutError):
                await until(lambda: len(self.heard) >= self.sent)
            self._dropped = subscription.statistics().dropped
            self._was_cut_off = ids != (publisher._core.id, subscription._core.id)


def wait_until(condition: Callable[[], object]) -> None:
    """Wait until `condition` is true; a time is only the bound. Raises TimeoutError."""
    end = time.monotonic() + WAIT_S
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError("it did not come about")
        time.sleep(0.002)


def resident_bytes(pid: int) -> int:
    """Memory that a process holds now."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * 4096


def with_limits(**limits: float) -> pytest.MarkDecorator:
    """Mark: the test's daemon runs with these limits (the fixture `settings`)."""
    lines = ["[limits]", *(f"{name} = {value}" for name, value in limits.items())]
    return pytest.mark.parametrize("settings", ["\n".join(lines)], ids=["limits"])


def answers(path: Path) -> bool:
    """Whether a server listens; its file exists a moment earlier."""
    with socket.socket(socket.AF_UNIX) as probe, contextlib.suppress(OSError):
        probe.connect(str(path))
        return True
    return False


def descriptors_of(pid: int) -> int:
    """The number of open descriptors of a process."""
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))
