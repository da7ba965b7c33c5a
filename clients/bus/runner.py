"""Runs an asyncio program on the fastest available loop, and ends it without a traceback at a signal."""

import asyncio
import gc
import signal
import sys
import threading
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from bus.base.loading import keep_frozen, loading
from bus.process.start_errors import START_ERRORS, text_of
from bus.process.termination import ReaderGone, Terminated, drop_unread_output, say_nothing_of_signals

T = TypeVar("T")

_PYTHONS_OWN = 1000
"""An upper bound of Python's own frozen objects: 3.12 has some hundreds; `gc.freeze()` freezes over 4,000."""


def loop_factory() -> Callable[[], asyncio.AbstractEventLoop] | None:
    """uvloop's factory, if it is installed; None means asyncio's own."""
    try:
        with loading():
            import uvloop
    except ImportError:
        return None
    return uvloop.new_event_loop


def run(main: Coroutine[Any, Any, T]) -> T:
    """Run `main` and return its result.

    Ctrl-C and SIGTERM cancel it: its `finally` and `async with` blocks run. Then KeyboardInterrupt is raised,
    for SIGTERM a subclass of it. If the program does not catch that, it dies by the same signal (shells check
    that) and prints no traceback. If `main` catches its cancellation, its result is returned. All this
    applies only in the main thread, and only if the program has set no signal handlers.

    SIGPIPE does the same if the program writes, by `print` or a logger, to a pipe that no process reads any
    more, as after `| head -1`. Other broken pipes and sockets raise BrokenPipeError only.

    `sys.exit` in any task or callback ends the program with that status and no traceback.

    If no busd answers and none may be started, or the command line or a variable as BUSD_DOMAIN can't be
    used, the program ends with one line that says so.

    Raises TypeError if `main` is not a coroutine, RuntimeError if an event loop runs already.

        bus.run(main())
    """
    try:  # around all calls, because a Ctrl-C may come at each
        _check(main)
        return _run(main)
    except KeyboardInterrupt:
        say_nothing_of_signals()
        raise
    finally:
        if asyncio.iscoroutine(main):
            main.close()  # it has not begun if a Ctrl-C came first, and Python would warn


def _run(main: Coroutine[Any, Any, T]) -> T:
    # Until the task begins, only Ctrl-C cancels it. asyncio itself forgets a Ctrl-C that comes at once.
    end: type[KeyboardInterrupt] | None = KeyboardInterrupt
    is_over = False

    async def until_signal() -> T:
        nonlocal end
        if is_over:
            raise asyncio.CancelledError
        end = None
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        assert task is not None

        def terminate() -> None:
            nonlocal end
            end = Terminated
            task.cancel()

        def lose_reader() -> None:
            nonlocal end
            if drop_unread_output():  # else the broken pipe or socket is not stdout or stderr
                end = ReaderGone
                task.cancel()

        if handles_term:
            loop.add_signal_handler(signal.SIGTERM, terminate)
        if handles_pipe:
            loop.add_signal_handler(signal.SIGPIPE, lose_reader)
        try:
            return await main
        finally:
            if handles_term:
                loop.remove_signal_handler(signal.SIGTERM)
            if handles_pipe:
                loop.remove_signal_handler(signal.SIGPIPE)
                signal.signal(signal.SIGPIPE, signal.SIG_IGN)  # Python's default; the loop leaves SIG_DFL

    handles_term = handles_pipe = is_frozen = False
    try:
        # Python handles signals only in the main thread.
        is_main = threading.current_thread() is threading.main_thread()
        handles_term = is_main and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
        handles_pipe = is_main and signal.getsignal(signal.SIGPIPE) is signal.SIG_IGN
        is_frozen = gc.get_freeze_count() > _PYTHONS_OWN  # by the program: these objects must stay frozen
        with asyncio.Runner(loop_factory=loop_factory()) as runner:
            runner.get_loop().set_exception_handler(_report)
            if not is_frozen:
                gc.freeze()  # imported objects stay, so no collection needs to check them
                keep_frozen(True)
            try:
                return runner.run(until_signal())
            except KeyboardInterrupt:
                # The interrupt may have come just after the task was made, before asyncio knows it. The task
                # must not begin while the loop is closed.
                is_over = True
                raise
    except asyncio.CancelledError:
        if end is None:
            raise
        raise end from None
    except BrokenPipeError:  # of a print, in `main` or a callback, before the signal was handled
        if not handles_pipe or (end is not ReaderGone and not drop_unread_output()):
            raise
        raise ReaderGone from None
    except TypeError as error:
        from bus.base.missing_names import explain_unknown_field

        explain_unknown_field(error)
        raise
    except START_ERRORS as error:
        sys.exit(text_of(error))
    finally:
        if not is_frozen:
            keep_frozen(False)
            gc.unfreeze()  # else Python would not find open files, to flush them


def _report(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Report an error as asyncio does, but not the SystemExit of a task: it has already ended the run.

    A program's own signal handler may raise SystemExit in any task, also in a task of `bus`.
    """
    if not isinstance(context.get("exception"), SystemExit):
        loop.default_exception_handler(context)


def _check(main: Any) -> None:
    """Raise an error for a call that can't work."""
    if not asyncio.iscoroutine(main):
        from bus.process.mistakes import no_coroutine

        raise no_coroutine(main)
    if asyncio._get_running_loop() is not None:
        from bus.process.mistakes import nested_run

        raise nested_run()
