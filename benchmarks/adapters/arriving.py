"""Programs that start one after the other: whether each gets in, and how long that takes.

They are forked from one that has imported everything, so that many can start in seconds. Says `ready`; on the
word `go` they start, and each says `arrived` with `took_s` from its start until it has a publisher, and with
the `error` that it ended with instead.
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
    """So many, one each `pause_s`."""

    number: int
    pause_s: float


async def _arrive(index: int) -> None:
    async with bus.Node(f"arriving_{index}", arguments=[], rosout=False) as node:
        await node.create_publisher(String, f"arriving_{index}")


def _be_program(index: int) -> None:
    """Never returns."""
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
    _ = bus.Node  # imported only now
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
    for pid in begun:  # they were not waited for, so the ids are still theirs
        os.kill(pid, signal.SIGKILL)


if __name__ == "__main__":
    main()
