"""An event loop that never waits: if nothing is left to do, its time jumps to the next timer.

    async def story() -> None:
        ...
        await asyncio.sleep(1000)   takes no time; due events come in order

    play(story)

So a test can require an event within 1000 seconds, and another not before 900, and no machine is too slow for
it. All participants must be in this loop: data sent by sockets and doorbells then arrive at once.

The clock of `bus` and `busd` jumps too, except the clock of the native core: data written into a ring after a
jump seem older than they are. So matches by shared memory have to be made before the first jump.
"""

import asyncio
import selectors
import sys
import time
from collections.abc import Callable, Coroutine, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

from bus.alarms import wake_up
from bus.endpoint import deadline

_LONGEST_S = 20_000
"""The longest story; after this time, it waits for an event that never comes."""
_MOST_TURNS = 50_000
"""The most turns of the loop in a row without an event; after these, it is an endless loop."""


class JumpingLoop(asyncio.SelectorEventLoop):
    """`jumped_s` is the lead of its time over the machine's."""

    def __init__(self) -> None:
        self.jumped_s = 0.0
        super().__init__(_Selector(self))

    def time(self) -> float:
        return super().time() + self.jumped_s

    def time_ns(self) -> int:
        return time.monotonic_ns() + round(self.jumped_s * 1e9)


class _Selector(selectors.DefaultSelector):
    def __init__(self, loop: JumpingLoop) -> None:
        super().__init__()
        self._loop = loop
        self._idle_turns = 0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None:  # the story has ended, and with it its time limit
            return super().select(None)
        found = super().select(0)
        self._idle_turns = 0 if found or timeout else self._idle_turns + 1
        if self._idle_turns > _MOST_TURNS:
            self._idle_turns = 0
            raise AssertionError("the loop goes round and round, and its time stands still")
        if not found:
            self._loop.jumped_s += timeout
        return found


def play(story: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Run `story` on such a loop."""

    async def bounded() -> None:
        async with asyncio.timeout(_LONGEST_S):
            await story()

    with asyncio.Runner(loop_factory=JumpingLoop) as runner:
        loop = runner.get_loop()
        assert isinstance(loop, JumpingLoop)
        with _clock_of(loop):
            runner.run(bounded())


@contextmanager
def _clock_of(loop: JumpingLoop) -> Iterator[None]:
    """Give all modules of the bus with a clock the clock of `loop`; none uses the kernel's timers."""
    assert deadline  # some modules load it late, but its clock must be replaced now
    clocks = {time.monotonic: loop.time, time.monotonic_ns: loop.time_ns}
    with ExitStack() as patches:
        patches.enter_context(patch.object(wake_up, "has_kernel_timer", lambda: False))
        for name, module in tuple(sys.modules.items()):
            if name.partition(".")[0] in ("bus", "busd"):
                for clock in (time.monotonic, time.monotonic_ns):
                    if getattr(module, clock.__name__, None) is clock:
                        patches.enter_context(patch.object(module, clock.__name__, clocks[clock]))
        yield
