"""Selects inputs to keep: the short ones first, and each that takes a new step.

A step is a pair of consecutive lines of our packages. It needs no fuzzer; atheris can't merge its findings.
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
    """Few of `inputs`, nearly the fewest, with which the target takes all the steps of all inputs."""
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
        with suppress(Exception):  # a failing target is the fuzzer's subject
            target(data)
    finally:
        sys.settrace(None)
    return found
