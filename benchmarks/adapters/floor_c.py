"""The floor in C: becomes the program of benchmarks/floors, by shared memory and eventfd, or by UNIX socket.

What ends in the subscriber's hands is a copy of the bytes; no `str` is made of them. One to one only.
"""

import os
import sys

from benchmarks.machine import ROOT
from benchmarks.work import Work
from benchmarks.worker import options

PROGRAM = ROOT / "benchmarks" / "floors" / "build" / "floor"
"""Made by `make` in that folder."""
WAY = "BENCH_C_WAY"
"""The variable that says which: shm or socket."""


def become(role: str, work: Work) -> None:
    """Go on as the program in C."""
    numbers = (work.size, work.count, work.warm_up, work.rate)
    words = (str(PROGRAM), role, os.environ[WAY], os.environ["BENCH_FOLDER"], *map(str, numbers))
    os.execv(PROGRAM, words)


if __name__ == "__main__":
    become(sys.argv[1], options(Work))
