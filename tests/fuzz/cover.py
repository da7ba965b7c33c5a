"""Which inputs of many are worth keeping: the short ones first, each that takes a step no other has taken.

A step is a line of our packages after another. Needs no fuzzer; atheris can't merge what it has found.
"""

import os
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import Any

from fuzz import OURS
from fuzz.targets import TARGETS

_OURS = tuple(str(Path(file).parent) + os.sep for name in OURS if (file := import_module(name).__file__))

Steps = set[tuple[str, int, int]]


def covering(name: str, inputs: Iterable[bytes]) -> list[bytes]:
    """As few of `inputs`, nearly, as make the target take all the steps that all of them make it take."""
    reached: Steps = set()
    kept: list[bytes] = []
    for data in sorted(set(inputs), key=lambda data: (len(data), data)):
        steps = _steps(TARGETS[name], data)
        if not steps <= reached:
            reached |= steps
            kept.append(data)
    return kept


def _steps(target: Callable[[bytes], None], data: bytes) -> Steps:
    found: Steps = set()

    def enter(frame: FrameType, event: str, argument: object) -> Any:
        path = frame.f_code.co_filename
        if not path.startswith(_OURS):
            return None
        last = 0

        def step(frame: FrameType, event: str, argument: object) -> Any:
            nonlocal last
            found.add((path, last, frame.f_lineno))
            last = frame.f_lineno
            return step

        return step

    sys.settrace(enter)
    try:
        with suppress(Exception):  # a target that fails is the fuzzer's business
            target(data)
    finally:
        sys.settrace(None)
    return found
