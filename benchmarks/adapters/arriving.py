"""Programs that start one after the other: measures whether each gets in, and how long that takes.

They are forked from a process that has imported everything, so many can start in seconds. It says `ready`. On
the word `go`, the programs start. Each says `arrived` with `took_s`, the time from its start until it has a
publisher. A program that fails adds its `error`.
"""

import asyncio
import os
import signal
import sys
from time import monotonic, sleep

import msgspec

import bus
from benchmarks.worker import LIFE_S, options, tell
from bus.msg.std_msgs import String
from bus.runner import loop_factory
from bus.types.support import type_support


class Programs(msgspec.Struct, frozen=True):
    """The number of programs to start, one every `pause_s`."""

    number: int
    pause_s: float


async def _arrive(index: int) -> None:
    async with bus.Node(f"arriving_{index}", arguments=[], rosout=False) as node:
        await node.create_publisher(String, f"arriving_{index}")


def _be_program(index: int) -> None:
    """Run one program; never returns."""
    begin_s, error = monotonic(), ""
    try:
        with asyncio.Runner(loop_factory=loop_factory()) as runner:
            runner.run(_arrive(index))
    except BaseException as failure:
        error = f"{type(failure).__name__}: {failure}"
    tell("arrived", took_s=monotonic() - begin_s, error=error)
    os._exit(0)


def main() -> None:
    programs: Programs = options(Programs)
    type_support(String)
    _ = bus.Node  # import it now, before the forks
    tell("ready")
    begun = []
    if sys.stdin.readline():
        for index in range(programs.number):
            begun.append(os.fork())
            if not begun[-1]:
                signal.alarm(LIFE_S)
                _be_program(index)
            sleep(programs.pause_s)
        sys.stdin.readline()
    for pid in begun:  # nothing has waited for them, so the ids still belong to them
        os.kill(pid, signal.SIGKILL)


if __name__ == "__main__":
    main()
