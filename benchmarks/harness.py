"""The harness of `bus bench`, for processes that run in this tree, and whose failures are published."""

import sys

from benchmarks.machine import ROOT
from bus_cli.bench import harness
from bus_cli.bench.harness import START_S, STOP_S, Child, Event, Failure

__all__ = ["START_S", "STOP_S", "Child", "Event", "Failure", "Group"]


class Group(harness.Group):
    """A group in the folder of this tree, with its busd."""

    def __init__(self) -> None:
        super().__init__(ROOT, (sys.executable, "-m", "busd"))
