"""Counts lines of Python that busd's core executes: steps, which do not depend on the load of the machine."""

from types import FrameType
from typing import Any

__all__ = ["LineCounter"]

_QUEUES = "bus.wire.runs"


class LineCounter:
    """Counts the executed lines of the core, and of the queues that it calls."""

    def __init__(self) -> None:
        self.lines = 0

    def enter(self, frame: FrameType, event: str, argument: Any) -> Any:
        module = frame.f_globals.get("__name__", "")
        caller = frame.f_back
        is_called_by_core = caller is not None and caller.f_trace is not None
        if not (module.startswith("busd.core.") or (module == _QUEUES and is_called_by_core)):
            return None
        self.lines += 1
        return self.step

    def step(self, frame: FrameType, event: str, argument: Any) -> Any:
        self.lines += event == "line"
        return self.step
