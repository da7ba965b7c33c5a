"""Tasks that wait for a change. Each checks itself whether it can continue."""

import asyncio


class Waiters:
    """The waiting tasks. True while there are any."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._waiting: list[asyncio.Future[None]] = []

    def __bool__(self) -> bool:
        return bool(self._waiting)

    async def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the next `release`; False if the time is over first. Raises the error of `fail`.

        Cancellation leaves nothing behind.
        """
        waiter = self._loop.create_future()
        self._waiting.append(waiter)
        try:
            if timeout_s is not None:
                await asyncio.wait([waiter], timeout=timeout_s)
                if not waiter.done():
                    return False
            await waiter
            return True
        except RuntimeError:
            if self._loop is asyncio.get_running_loop():
                raise
            from bus.process.mistakes import other_loop

            raise other_loop("what is waited for", self._loop) from None
        finally:
            if waiter in self._waiting:
                self._waiting.remove(waiter)

    def release(self) -> None:
        """Let all waiting tasks check again."""
        if waiting := self._waiting:
            self._waiting = []
            for waiter in waiting:
                if not waiter.done():
                    waiter.set_result(None)

    def fail(self, reason: BaseException) -> None:
        """Raise `reason` in all waiting tasks."""
        waiting, self._waiting = self._waiting, []
        for waiter in waiting:
            if not waiter.done():
                waiter.set_exception(reason)
