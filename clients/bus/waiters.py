"""Tasks that wait for a change, and look for themselves whether it is theirs."""

import asyncio


class Waiters:
    """True while somebody waits."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._waiting: list[asyncio.Future[None]] = []

    def __bool__(self) -> bool:
        return bool(self._waiting)

    async def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the next `release`; False where the time is over first. Raises what `fail` was given.

        Cancellation leaves nothing behind.
        """
        waiter = self._loop.create_future()
        self._waiting.append(waiter)
        try:
            done, _ = await asyncio.wait([waiter], timeout=timeout_s) if timeout_s else ([await waiter], ())
            if timeout_s and done:
                waiter.result()
            return bool(done)
        finally:
            if waiter in self._waiting:
                self._waiting.remove(waiter)

    def release(self) -> None:
        """All who wait look again."""
        waiting, self._waiting = self._waiting, []
        for waiter in waiting:
            if not waiter.done():
                waiter.set_result(None)

    def fail(self, reason: BaseException) -> None:
        """All who wait get `reason`."""
        waiting, self._waiting = self._waiting, []
        for waiter in waiting:
            if not waiter.done():
                waiter.set_exception(reason)
