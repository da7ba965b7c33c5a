"""Runs an asyncio program on the fastest loop there is, and ends it quietly when it is told to end."""

import asyncio
import gc
import signal
import sys
import threading
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from bus.errors import BrokerUnavailable

T = TypeVar("T")


def loop_factory() -> Callable[[], asyncio.AbstractEventLoop] | None:
    """uvloop's, where it is installed; None means asyncio's own."""
    try:
        import uvloop
    except ImportError:
        return None
    return uvloop.new_event_loop


def run(main: Coroutine[Any, Any, T]) -> T | None:
    """Run `main` and return its result, or None where Ctrl-C or SIGTERM ended it (in the main thread only).

    Both cancel `main`, so that its `finally` and `async with` blocks run; no traceback is printed. Where no
    busd answers and none may be started, the program ends with one line that says so.

    Raises TypeError for what is no coroutine, RuntimeError where an event loop runs already.
    """
    _check(main)
    with asyncio.Runner(loop_factory=loop_factory()) as runner:
        try:
            gc.freeze()  # what was imported stays: no collection need look at it
            return runner.run(_with_sigterm(main))
        except KeyboardInterrupt:
            return None
        except BrokerUnavailable as error:
            sys.exit(f"{type(error).__name__}: {error}")


def _check(main: Any) -> None:
    """Say what is wrong with a call that can't work, without warnings of a coroutine that nobody awaits."""
    if not asyncio.iscoroutine(main):
        from bus.mistakes import no_coroutine

        raise no_coroutine(main)
    if asyncio._get_running_loop() is not None:
        from bus.mistakes import nested_run

        main.close()
        raise nested_run()


async def _with_sigterm(main: Coroutine[Any, Any, T]) -> T | None:
    if threading.current_thread() is not threading.main_thread():
        return await main  # Python gives signals to the main thread alone
    loop = asyncio.get_running_loop()
    task = asyncio.current_task()
    assert task is not None
    is_terminated = False

    def terminate() -> None:
        nonlocal is_terminated
        is_terminated = True
        task.cancel()

    loop.add_signal_handler(signal.SIGTERM, terminate)
    try:
        return await main
    except asyncio.CancelledError:
        if not is_terminated:
            raise
        return None
    finally:
        loop.remove_signal_handler(signal.SIGTERM)
