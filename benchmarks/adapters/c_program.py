"""A publisher or subscriber in C: runs a program of benchmarks/c.

One publisher and one subscriber only.
"""

import os
import sys
from pathlib import Path

from benchmarks.machine import ROOT
from benchmarks.work import Work
from benchmarks.worker import options

FOLDER = ROOT / "benchmarks" / "c"
"""`make` in that folder builds the programs."""
PROGRAM = "BENCH_C_PROGRAM"
"""The variable with the program's name."""
WAY = "BENCH_C_WAY"
"""The variable with the way that the program uses."""


def path_of(name: str) -> Path:
    """The built program."""
    return FOLDER / "build" / name


def become(role: str, work: Work) -> None:
    """Replace this process by the program in C."""
    program = path_of(os.environ[PROGRAM])
    numbers = (work.size, work.count, work.warm_up, work.rate)
    words = (str(program), role, os.environ[WAY], os.environ["BENCH_FOLDER"], *map(str, numbers))
    os.execv(program, words)


if __name__ == "__main__":
    become(sys.argv[1], options(Work))
