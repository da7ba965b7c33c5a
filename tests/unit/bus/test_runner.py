"""bus.runner: what a run leaves of the garbage collector as it was."""

import subprocess
import sys

import pytest

_PROGRAM = """
import asyncio, gc, sys
import bus

if "frozen" in sys.argv:
    gc.freeze()

async def count():
    return gc.get_freeze_count()

before, within, after = gc.get_freeze_count(), bus.run(count()), gc.get_freeze_count()
print(before > 0, within > 0, after > 0)
"""


@pytest.mark.parametrize(("word", "said"), [("", "False True False"), ("frozen", "True True True")])
def test_what_a_program_has_frozen_stays_frozen(word: str, said: str) -> None:
    command = [sys.executable, "-c", _PROGRAM, word]
    assert subprocess.run(command, capture_output=True, text=True, timeout=60).stdout.strip() == said
