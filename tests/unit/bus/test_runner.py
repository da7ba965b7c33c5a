"""bus.runner: a run restores the state of the garbage collector, and a Ctrl-C before a run is silent."""

import signal
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
print(*(count > 1000 for count in (before, within, after)))  # Python 3.12 begins with some hundreds
"""


@pytest.mark.parametrize(("word", "said"), [("", "False True False"), ("frozen", "True True True")])
def test_what_a_program_has_frozen_stays_frozen(word: str, said: str) -> None:
    command = [sys.executable, "-c", _PROGRAM, word]
    assert subprocess.run(command, capture_output=True, text=True, timeout=60).stdout.strip() == said


def test_a_ctrl_c_before_main_begins_is_silent() -> None:
    """Otherwise Python would warn that `main` was never awaited."""
    program = """
import asyncio, signal
import bus

signal.signal(signal.SIGINT, signal.default_int_handler)

async def main():
    print("main begins")

def factory():
    loop = asyncio.SelectorEventLoop()
    loop.call_soon(signal.raise_signal, signal.SIGINT)  # before the first step of the task
    return loop

import bus.runner
bus.runner.loop_factory = lambda: factory
bus.run(main())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, "", "")


def test_a_ctrl_c_while_the_task_is_made_is_silent() -> None:
    """The task may be scheduled while asyncio does not know it yet. In that case, asyncio does not
    cancel it.
    """
    program = """
import asyncio
import bus, bus.runner

class Loop(asyncio.SelectorEventLoop):
    is_first = True

    def create_task(self, coro, **more):
        task = super().create_task(coro, **more)
        if self.is_first:
            self.is_first = False
            asyncio.tasks._unregister_task(task)
            raise KeyboardInterrupt
        return task

bus.runner.loop_factory = lambda: Loop

async def main():
    print("main begins")
    try:
        await asyncio.sleep(1)
    finally:
        await asyncio.sleep(1)

bus.run(main())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, "", "")


def test_a_ctrl_c_that_asyncio_forgets_is_silent() -> None:
    """asyncio's runner installs its handler and then sets its number of Ctrl-C to 0: one in between cancels
    the task, but raises no KeyboardInterrupt.
    """
    program = """
import asyncio, functools, signal
import bus

signal.signal(signal.SIGINT, signal.default_int_handler)
install = signal.signal

def install_and_interrupt(number, handler):
    before = install(number, handler)
    if isinstance(handler, functools.partial):
        signal.raise_signal(number)
    return before

async def main():
    print("main begins")

signal.signal = install_and_interrupt
bus.run(main())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, "", "")
