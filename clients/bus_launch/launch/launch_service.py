"""Runs launch descriptions: takes events out of the queue, has them handled, ends when nothing is left.

Owns: the event loop of a launch, its signals, its return code. Must not know: actions, files.
"""

import asyncio
import os
import signal
import threading
import traceback
from collections.abc import Callable, Iterable
from typing import Any, Final

from bus_launch.launch import child, logging
from bus_launch.launch.core import (
    Event,
    Futures,
    LaunchContext,
    LaunchDescriptionEntity,
    SomeEntitiesType,
    normalize_to_list_of_entities,
    visit_all,
)
from bus_launch.launch.errors import describe
from bus_launch.launch.event_handlers import OnIncludeLaunchDescription, OnShutdown
from bus_launch.launch.events import IncludeLaunchDescription, Shutdown

__all__ = ["LaunchService"]

_ENDING: Final = (signal.SIGTERM, signal.SIGQUIT, signal.SIGHUP)


class LaunchService:
    """Runs the included launch descriptions; `run` returns 0, or 1 after an error."""

    def __init__(
        self,
        *,
        argv: Iterable[str] | None = None,
        noninteractive: bool = False,
        debug: bool = False,
    ) -> None:
        """`argv`: for actions that look at it. `noninteractive`: say of each signal that it is sent."""
        self.__debug = debug
        if debug:
            logging.launch_config.level = 10
        self.__context = LaunchContext(argv=argv, noninteractive=noninteractive)
        self.__context.register_event_handler(OnIncludeLaunchDescription())
        self.__context.register_event_handler(OnShutdown(on_shutdown=self.__on_shutdown))
        self.__logger = logging.get_logger("launch")
        self.__pending: set[asyncio.Future[Any]] = set()
        self.__lock = threading.RLock()
        self.__loop: asyncio.AbstractEventLoop | None = None
        self.__task: asyncio.Task[Any] | None = None
        self.__is_shutting_down = False
        self.__interrupts = 0
        self.__return_code = 0
        self.ended_by: signal.Signals | None = None
        """The last signal other than SIGINT. After a Ctrl-C the launch has ended well."""

    @property
    def context(self) -> LaunchContext:
        return self.__context

    @property
    def event_loop(self) -> asyncio.AbstractEventLoop | None:
        return self.__loop

    @property
    def task(self) -> "asyncio.Task[Any] | None":
        return self.__task

    def emit_event(self, event: Event) -> None:
        """From any thread; before `run` it waits for that."""
        with self.__lock:
            loop = self.__loop
        if loop is None:
            self.__context.emit_event_sync(event)
        else:
            loop.call_soon_threadsafe(self.__context.emit_event_sync, event)

    def include_launch_description(self, launch_description: LaunchDescriptionEntity) -> None:
        """From any thread: have all its entities visited."""
        self.emit_event(IncludeLaunchDescription(launch_description))

    def shutdown(self, force_sync: bool = False) -> Any:
        """From any thread: have all processes end, then `run`."""
        with self.__lock:
            if self.__loop is not None:  # after events that this thread has emitted
                self.__loop.call_soon_threadsafe(self.__shut_down, "LaunchService.shutdown() called")

    def run(self, *, shutdown_when_idle: bool = True) -> int:
        """Until nothing is left to do; without `shutdown_when_idle` until `shutdown`."""
        return asyncio.run(self.run_async(shutdown_when_idle=shutdown_when_idle), debug=self.__debug)

    async def run_async(self, *, shutdown_when_idle: bool = True) -> int:
        """As `run`, in a running loop. Cancelled, it has all processes end first."""
        loop = asyncio.get_running_loop()
        with self.__lock:
            if self.__loop is not None:
                raise RuntimeError("LaunchService.run() called from multiple threads concurrently.")
            self.__loop = loop
            self.__task = asyncio.current_task()
        self.__context._set_asyncio_loop(loop)
        logging.launch_config.on_closed_screen = self.__on_closed_screen
        if logging.launch_config.is_screen_closed:
            self.__on_closed_screen()
        restore = self.__catch_signals(loop)
        try:
            while True:
                try:
                    await self.__process_events(shutdown_when_idle)
                    return self.__return_code
                except asyncio.CancelledError:
                    self.__shut_down("cancelled")
        finally:
            restore()
            logging.launch_config.on_closed_screen = None
            await child.end_all()
            while self.__context._at_end:
                self.__context._at_end.pop()()
            self.__context._set_asyncio_loop(None)
            with self.__lock:
                self.__loop = self.__task = None
                self.__is_shutting_down = False

    async def __process_events(self, shutdown_when_idle: bool) -> None:
        queue = self.__context._event_queue
        while True:
            is_idle = self._is_idle()
            if is_idle and self.__is_shutting_down:
                return
            if is_idle and shutdown_when_idle:
                self.__shut_down("idle")
            event = await queue.get()
            try:
                if event is not None:
                    self.__process(event)
            finally:
                queue.task_done()

    def _is_idle(self) -> bool:
        context = self.__context
        return context._event_queue.empty() and not self.__pending and not context._completion_futures

    def __process(self, event: Event) -> None:
        self.__logger.debug(f"processing event: '{event}'")
        for handler in tuple(self.__context._event_handlers):
            self.__context._push_locals()
            try:
                if handler.matches(event):
                    self.__visit(handler.handle(event, self.__context))
            except Exception as error:  # other handlers must get the event, for example a shutdown
                self.__fail(error)
            finally:
                self.__context._pop_locals()

    def __visit(self, entities: SomeEntitiesType | None) -> None:
        for entity in normalize_to_list_of_entities(entities):
            found: Futures = []
            try:
                visit_all(entity, self.__context, found)
            finally:  # work begun before an exception must end in order, too
                for _, future in found:
                    if not future.done():
                        self.__pending.add(future)
                        future.add_done_callback(self.__done)
                    else:
                        self.__done(future)

    def __done(self, future: "asyncio.Future[Any]") -> None:
        self.__pending.discard(future)
        if not future.cancelled() and (error := future.exception()) is not None:
            self.__fail(error)
        self.__context._event_queue.put_nowait(None)

    def __fail(self, error: BaseException) -> None:
        text = f"Caught exception in launch (see debug for traceback): {describe(error)}"
        self.__logger.debug("".join(traceback.format_exception(error)))
        self.__logger.error(text)
        self.__return_code = 1
        self.__shut_down(text)

    # --- the end

    def __shut_down(self, reason: str, *, due_to_sigint: bool = False) -> None:
        if not self.__is_shutting_down:
            self.__is_shutting_down = True
            self.__context._set_is_shutdown(True)
            self.emit_event(Shutdown(reason=reason, due_to_sigint=due_to_sigint))

    def __on_shutdown(self, event: Event, context: LaunchContext) -> None:
        self.__is_shutting_down = True
        context._set_is_shutdown(True)

    def __catch_signals(self, loop: asyncio.AbstractEventLoop) -> Callable[[], None]:
        """Returns a function that restores the signal handlers."""
        if threading.current_thread() is not threading.main_thread():
            return lambda: None
        calls = dict.fromkeys(_ENDING, self.__on_signal)
        calls |= {signal.SIGINT: self.__on_sigint, signal.SIGTSTP: self.__on_stop}
        before = {number: signal.getsignal(number) for number in calls}
        for number, call in calls.items():
            loop.add_signal_handler(number, call, number)

        def restore() -> None:
            for number, handler in before.items():
                loop.remove_signal_handler(number)
                signal.signal(number, handler)

        return restore

    def __on_sigint(self, number: signal.Signals) -> None:
        self.__interrupts += 1
        text = "user interrupted with ctrl-c (SIGINT)"
        if self.__interrupts == 1:
            self.__logger.warning(text)
            self.__shut_down("ctrl-c (SIGINT)", due_to_sigint=True)
        else:
            self.__logger.warning(f"{text} again, ignoring...")
            child.signal_all(number)  # a terminal would have told them, too

    def __on_stop(self, number: signal.Signals) -> None:
        """The terminal's Ctrl-Z: all stand still, and go on together."""
        child.signal_all(signal.SIGSTOP)
        os.kill(os.getpid(), signal.SIGSTOP)
        child.signal_all(signal.SIGCONT)

    def __on_closed_screen(self) -> None:
        self.__shut_down("nobody reads stdout")

    def __on_signal(self, number: signal.Signals) -> None:
        self.ended_by = number
        if not self.__is_shutting_down:
            self.__logger.warning(f"{number.name} received: ending all processes")
        self.__shut_down(number.name)
