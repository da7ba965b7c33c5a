"""The floor in C: runs the program of benchmarks/floors, with shared memory and eventfd, or with a UNIX
socket.

The subscriber ends with a copy of the bytes, and does not make a `str` of them. One publisher and one
subscriber only.
"""

import os
import sys

from benchmarks.machine import ROOT
from benchmarks.work import Work
from benchmarks.worker import options

PROGRAM = ROOT / "benchmarks" / "floors" / "build" / "floor"
"""`make` in that folder builds it."""
WAY = "BENCH_C_WAY"
"""The variable with the way: shm or socket."""


def become(role: str, work: Work) -> None:
    """Replace this process by the program in C."""
    numbers = (work.size, work.count, work.warm_up, work.rate)
    words = (str(PROGRAM), role, os.environ[WAY], os.environ["BENCH_FOLDER"], *map(str, numbers))
    os.execv(PROGRAM, words)


if __name__ == "__main__":
    become(sys.argv[1], options(Work))
