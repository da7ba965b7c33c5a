"""Publishes the messages of a far publisher by its mirror on this bus; lossless messages wait for room.

Owns the waiting messages, and counts published and dropped ones. Must not know the source of messages.
"""

import asyncio
from collections.abc import Callable
from typing import Any

from bus.errors import BusError, ConnectionClosed, PayloadTooLarge
from bus.publisher import Publisher
from bus.vocabulary import DropReason
from bus_bridge.batch import Batch
from bus_bridge.core.accounts import Account
from bus_bridge.core.waiting import Waiting
from bus_bridge.packed import Packed

__all__ = ["Publishing"]

_MOST_BYTES = 64 << 20
_STUCK_S = 2.0
_MAX_TIME_NS = 1 << 63
_AT_ONCE = 256


class Publishing:
    """Publishes messages of one mirror.

    `on_gone` is called with the bytes of waiting messages that were published. `on_trouble` gets an
    explanation if messages can't be published.
    """

    def __init__(
        self,
        publisher: Publisher[Any],
        account: Account,
        on_gone: Callable[[int], None],
        on_trouble: Callable[[str], object],
        *,
        is_lossless: bool,
    ) -> None:
        self.publisher = publisher
        self.account = account
        self.waiting = Waiting(_MOST_BYTES)
        self.is_broken = False
        """The mirror was closed, for example because a new busd refused it. It has to be made again."""
        self._on_gone = on_gone
        self._on_trouble = on_trouble
        self._is_lossless = is_lossless
        self._pumping: asyncio.Task[None] | None = None

    def publish(self, batch: Batch) -> int:
        """Publish the messages; returns how many of the first ones are done.

        The result is only less than all if the publisher is lossless and has no room.
        """
        if batch.__class__ is not Packed:
            return self._publish_each(batch)
        try:
            done = self.publisher.publish_packed(batch.whole, batch.start)
        except BusError:  # the bridge makes the mirror again
            return self._publish_each(batch)
        account = self.account
        account.sent += done
        account.bytes += batch.payload_bytes
        if done == batch.count:
            return done
        rest = batch.after(done)
        account.bytes -= rest.payload_bytes
        return done + self._publish_each(rest)

    def publish_or_wait(self, batch: Batch) -> None:
        """Publish the messages. Without room they wait behind earlier ones."""
        waiting = self.waiting
        if not waiting.count:
            done = self.publish(batch)
            if done == batch.count:
                return
            batch = batch.after(done)
        _, over = waiting.put(batch, None)
        self.account.drop(DropReason.MEMORY_LIMIT, over)
        if self._pumping is None:
            self._pumping = asyncio.get_running_loop().create_task(self._pump())

    def cancel(self) -> None:
        """Stop; waiting messages are lost."""
        if self._pumping is not None:
            self._pumping.cancel()

    async def finish(self) -> int:
        """Publish waiting messages while there is progress; returns the number of lost ones.

        Cancellation: all waiting messages are lost.
        """
        try:
            while self._pumping is not None:
                before = self.account.sent
                await asyncio.wait((self._pumping,), timeout=_STUCK_S)
                if self.account.sent == before:
                    break
        finally:
            self.cancel()
            lost = self.waiting.clear()
            self.account.drop(DropReason.DISCONNECTED, lost)
        return lost

    async def _pump(self) -> None:
        try:
            while True:
                await self.publisher.wait_for_room()
                if not self._publish_waiting():
                    return
        except ConnectionClosed as error:
            self._fail(error, self.waiting.count)
            self.waiting.clear()
        finally:
            self._pumping = None

    def _publish_waiting(self) -> bool:
        """Publish waiting messages; returns whether there is no room for the next one."""
        waiting, before, is_full = self.waiting, self.waiting.bytes, False
        while not is_full and (batch := waiting.first(_AT_ONCE)) is not None:
            done = self.publish(batch)
            waiting.remove(done)
            is_full = done < batch.count
        if gone := before - waiting.bytes:
            self._on_gone(gone)
        return is_full

    def _publish_each(self, batch: Batch) -> int:
        publish, done, failed, size = self.publisher.publish_encoded, 0, 0, 0
        for payload, _, source_time_ns in batch:
            try:
                right_ns = source_time_ns if 0 < source_time_ns < _MAX_TIME_NS else None
                if not publish(payload, source_time_ns=right_ns) and self._is_lossless:
                    break
                size += len(payload)
            except BusError as error:
                self._fail(error)
                failed += 1
            done += 1
        self.account.sent += done - failed
        self.account.bytes += size
        return done

    def _fail(self, error: BusError, count: int = 1) -> None:
        reason = DropReason.TOO_LARGE if isinstance(error, PayloadTooLarge) else DropReason.REFUSED
        self.account.drop(reason, count)
        self.is_broken |= isinstance(error, ConnectionClosed)
        self._on_trouble(str(error))
