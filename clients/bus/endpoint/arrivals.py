"""Tasks that wait for the next message of a subscription.

A message that comes is decoded at once, and only the first task is woken. It finds the message in the
receiver's `ahead`. If all tasks were woken before a message is decoded, each would look for it in all
queues: a third more calls, right after a sleep, when each call is slow.

Until the task runs, the message counts as queued, and any other call may take it.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from bus.delivery.receiver import Receiver, Taken
from bus.wire.runs import Run

__all__ = ["Arrivals"]

M = TypeVar("M")


class Arrivals(Generic[M]):
    """`is_direct` False: a task is only woken, and takes the message itself.

    True while a task waits.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        receiver: Receiver[M],
        on_error: Callable[[Exception], object],
        *,
        is_direct: bool,
    ) -> None:
        self._loop = loop
        self._receiver = receiver
        self._ahead = receiver.ahead
        self._is_direct = is_direct
        self._waiting: deque[asyncio.Future[None]] = deque()
        self._idle: list[None] = [None]
        """Empty while a task waits to be given a message: only then the native reader calls `_give`."""
        if is_direct and receiver.reader is not None:
            receiver.call_back_with_taken(self._give, on_error, self._idle)

    def __bool__(self) -> bool:
        return bool(self._waiting)

    async def wait(self) -> Taken[M] | None:
        """Wait for the next message, and take it. None: something has changed, look for a message.

        Cancellation leaves nothing behind: the message that woke this task is left to the others.
        """
        waiter: asyncio.Future[None] = self._loop.create_future()
        self._waiting.append(waiter)
        if self._is_direct:
            self._idle.clear()
        try:
            await waiter
            return self._ahead.popleft() if self._ahead else None
        except BaseException as error:
            if waiter.done() and not waiter.cancelled() and not self._loop.is_closed():
                self._loop.call_soon_threadsafe(self.release)
            if not isinstance(error, RuntimeError) or self._loop is asyncio.get_running_loop():
                raise
            from bus.process.mistakes import other_loop

            raise other_loop("what is waited for", self._loop) from None
        finally:
            if waiter in self._waiting:
                self._waiting.remove(waiter)
                self._rest()

    def release(self) -> None:
        """Wake all waiting tasks: each looks for a message itself."""
        if self._waiting:
            waiting, self._waiting = self._waiting, deque()
            self._rest()
            for waiter in waiting:
                if not waiter.done():
                    waiter.set_result(None)

    def receive_lone(self, run: Run) -> bool:
        """Give the message of a run that came alone to the first task; False: nothing was done, put it."""
        if not self._waiting or not self._is_direct or (taken := self._receiver.take_lone(run)) is None:
            return False
        self._give(taken)
        return True

    def stop_giving(self) -> None:
        """From now on tasks are only woken."""
        self._is_direct = False
        self._rest()

    def end(self) -> None:
        """The subscription can't be used any more: tasks that wait find out why."""
        self.release()
        if self._receiver.reader is not None:
            self._receiver.reader.forget_callback()

    def _give(self, taken: Taken[Any]) -> None:
        self._ahead.append(taken)
        waiting = self._waiting
        while waiting:
            waiter = waiting.popleft()
            if not waiter.done():  # else its task was cancelled just now
                waiter.set_result(None)
                break
        if not waiting:
            self._idle.append(None)

    def _rest(self) -> None:
        if not self._idle and not (self._waiting and self._is_direct):
            self._idle.append(None)
