"""An event loop that never waits: where nothing is left to be done, its time jumps to the next timer.

    async def story() -> None:
        ...
        await asyncio.sleep(1000)   takes no time; what is due meanwhile comes in its order

    play(story)

So a test says what is to come within 1000 seconds and what not before 900, and no machine is too slow for
it. All that takes part must be in this loop: then what is said by sockets and doorbells is there at once.

The clock of `bus` and `busd` jumps too, but for that of the native core: what is written into a ring after a
jump seems older than it is. So matches by shared memory are to be made before the first one.
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
"""No story lasts longer: it waits for what never comes."""
_MOST_TURNS = 50_000
"""No story needs so many turns of the loop on end in which nothing comes: it goes round and round."""


class JumpingLoop(asyncio.SelectorEventLoop):
    """`jumped_s` is how far its time is ahead of the machine's."""

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
        if timeout is None:  # the story has ended, and with it its own time-out
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
    """All modules of the bus that have a clock have that of `loop`, and none uses the kernel's timers."""
    assert deadline  # loaded late by those who have one: its clock must be there now
    clocks = {time.monotonic: loop.time, time.monotonic_ns: loop.time_ns}
    with ExitStack() as patches:
        patches.enter_context(patch.object(wake_up, "has_kernel_timer", lambda: False))
        for name, module in tuple(sys.modules.items()):
            if name.partition(".")[0] in ("bus", "busd"):
                for clock in (time.monotonic, time.monotonic_ns):
                    if getattr(module, clock.__name__, None) is clock:
                        patches.enter_context(patch.object(module, clock.__name__, clocks[clock]))
        yield
