"""The way in of one far publisher's messages: from the engine's reader to its mirror on this bus.

Reads while the mirror has subscriptions. Owns the numbers that came last, what waits for room, and what
became of each message. Must not know nodes or the graph.
"""

import asyncio
from collections.abc import Callable, Sequence
from time import monotonic_ns
from typing import Any

from bus.endpoint.core import summed
from bus.errors import BusError, ConnectionClosed, PayloadTooLarge
from bus.publisher import Publisher
from bus.qos import Durability, History
from bus.schema import MessageSchema
from bus_bridge.core.accounts import Account
from bus_bridge.core.lateness import Lateness
from bus_bridge.core.pasts import Past
from bus_bridge.core.waiting import RateLimit, Waiting
from bus_bridge.engine import Engine, FarEndpoint, Reader, Sample
from bus_bridge.errors import in_words
from bus_bridge.packed import Packed, number_and_time, payload_bytes
from bus_bridge.reasons import DISCONNECTED, EXPIRED, MEMORY, RATE, REFUSED, REPEATED, TOO_LARGE

__all__ = ["Import"]

_MOST_BYTES = 64 << 20
_LINGER_S = 2.0
"""How long messages are still read after the last subscription has gone: with busd it comes back soon."""
_RETRY_S = 2.0
_STUCK_S = 2.0
_MAX_TIME_NS = 1 << 63
_STEP_NS = 100_000_000
"""By so much a publisher's times may fall from one message to the next without its clock having been set."""
_AT_ONCE = 256


class Import:
    """`on_trouble` hears, in words, what keeps messages out. `numbering`: as in Past."""

    def __init__(
        self,
        engine: Engine,
        endpoint: FarEndpoint,
        schema: MessageSchema,
        publisher: Publisher[Any],
        lateness: Lateness,
        on_trouble: Callable[[str], object],
        *,
        numbering: str = "",
        max_rate_hz: float | None = None,
    ) -> None:
        self.account = Account()
        self.publisher = publisher
        self._engine = engine
        self._endpoint = endpoint
        self._schema = schema
        self._publish = publisher.publish_encoded
        self._lateness = lateness
        self._newest_ns = 0
        """When the publisher published what came last, by its clock."""
        self._known_ns = self._most_known = 0
        """After a change of numbers: up to so many messages, published up to this time, have come before."""
        self._numbering = numbering
        self._on_trouble = on_trouble
        self._loop = asyncio.get_running_loop()
        self._reader: Reader | None = None
        self._lost_before: dict[str, int] = {}
        """By reason, what earlier readers had and lost."""
        self._last = 0
        self._is_fresh = True
        """Nothing has come yet since it is read: what comes next may begin anywhere. What was missed until
        then is lost for `_listeners` only."""
        self._listeners: frozenset[bytes] = frozenset()
        """Subscriptions that had what came last before the matches changed, by gid."""
        self._matched: frozenset[bytes] = frozenset()
        self._last_noted = 0
        self._may_repeat = False
        self._lifespan_ns = endpoint.qos.lifespan_ns
        self._is_lossless = endpoint.qos.is_lossless
        self._limit = None if max_rate_hz is None else RateLimit(max_rate_hz)
        self._waiting = Waiting(_MOST_BYTES)
        self._pumping: asyncio.Task[None] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._is_closed = False
        self.is_broken = False
        """The mirror has been ended, as by a new busd that has refused it: another one is to be made."""

    def resume(self, past: Past) -> None:
        """Go on where an earlier way of the publisher ended; before anything else."""
        self.account, self._lost_before = past.account, past.lost_before
        self._last = self._last_noted = past.last
        self._listeners, self._newest_ns = past.listeners, past.newest_ns
        # A new mirror has none of what late joiners get, so that is to come once more.
        self._may_repeat = self._endpoint.qos.durability is Durability.TRANSIENT_LOCAL
        if past.numbering != self._numbering:
            self._renumber()

    @property
    def waiting(self) -> int:
        return len(self._waiting)

    @property
    def is_flowing(self) -> bool:
        return self._reader is not None

    @property
    def taken(self) -> int:
        """Messages that have come, with those that the engine had and lost."""
        return self.account.taken + sum(self._lost_by_engine.values())

    @property
    def losses(self) -> dict[str, int]:
        """All that did not go on, by reason."""
        return summed(self.account.losses, self._lost_by_engine)

    @property
    def _lost_by_engine(self) -> dict[str, int]:
        return summed(self._lost_before, {} if self._reader is None else self._reader.lost)

    def look(self) -> None:
        """The mirror's matches have changed: read, or read no longer."""
        if self._is_closed:
            return
        self._note_listeners()
        is_wanted = bool(self._matched)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if is_wanted and self._reader is None:
            self._read()
        elif not is_wanted and self._reader is not None:
            self._timer = self._loop.call_later(_LINGER_S, self._stop)

    def begin_again(self, endpoint: FarEndpoint, *, numbering: str = "") -> None:
        """The far side was away and is back: what it had before does not come twice, and what was missed is
        lost. `numbering`: as in Past; other numbers may begin at 1."""
        self._stop()
        self._endpoint = endpoint
        if numbering != self._numbering:
            self._numbering = numbering
            self._renumber()
        self.look()

    def past(self) -> Past:
        """For the way that follows, should the publisher come back; to be asked before this one ends."""
        self._note_listeners()
        last, listeners, numbering = self._last, self._listeners, self._numbering
        return Past(last, listeners, self.account, self._lost_by_engine, numbering, self._newest_ns)

    def end(self) -> None:
        """The bridge ends: read no more; what waits is lost."""
        self._is_closed = True
        if self._timer is not None:
            self._timer.cancel()
        if self._pumping is not None:
            self._pumping.cancel()
        self._stop()

    async def finish(self) -> None:
        """The far publisher has gone: read no more, and publish what waits for room, for as long as that goes
        on. Cancellation: as at the end, what waits is lost."""
        self._is_closed = True
        if self._timer is not None:
            self._timer.cancel()
        self._stop()
        try:
            while self._pumping is not None:
                before = self.account.sent
                await asyncio.wait((self._pumping,), timeout=_STUCK_S)
                if self.account.sent == before:
                    break
        finally:
            if self._pumping is not None:
                self._pumping.cancel()
            lost = self._waiting.clear()
            self.account.drop(DISCONNECTED, lost)
        if lost:
            self._on_trouble(
                f"their publisher has gone, and there was no room for all (messages lost: {lost})"
            )

    def receive(self, samples: Sequence[Sample]) -> None:
        """The next messages of the far publisher, from the reader. Never raises."""
        if self._is_closed or not samples:
            return
        try:
            self._receive(samples)
        except Exception as error:  # one way in must not end the others
            self._on_trouble(in_words(error))

    def _receive(self, samples: Sequence[Sample]) -> None:
        account, size = self.account, 0
        account.taken += len(samples)
        if self._is_lossless:
            size = self._waiting.bytes + payload_bytes(samples)
        if self._most_known:
            samples = self._without_known(samples)
        if samples and not self._is_next(samples):
            samples = self._without_repeated(samples)
        if self._lifespan_ns:
            samples = self._without_expired(samples)
        elif samples:
            self._note(monotonic_ns(), number_and_time(samples, -1)[1])
        if self._limit is not None:
            passing = self._limit.passing(samples)
            account.drop(RATE, len(samples) - len(passing))
            samples = passing
        if not self._is_lossless:
            self._publish_all(samples)
            return
        if not self._waiting:  # nothing waits, so what has room needs not wait either
            samples = samples[self._publish_all(samples) :]
        _, over = self._waiting.put(samples, None)
        account.drop(MEMORY, over)
        if self._reader is not None and (gone := size - self._waiting.bytes):
            self._reader.taken(gone)  # also of what is dropped here: the writer does not wait for that
        if self._waiting and self._pumping is None:
            self._pumping = self._loop.create_task(self._pump_on())

    # --- inside

    def _renumber(self) -> None:
        """The messages to come have other numbers than those before. What came before is known by its time:
        it is what the publisher keeps, or what waited for the new way, up to the publisher's depth."""
        qos, sent = self._endpoint.qos, self.account.sent
        if not self._may_repeat:
            self._most_known = min(qos.depth, sent) if qos.history is History.KEEP_LAST else sent
            self._known_ns = self._newest_ns
        self._may_repeat = False
        self._last = self._last_noted = 0
        self._listeners = frozenset()

    def _note_listeners(self) -> None:
        """The matches may have changed: remember which subscriptions had what came last. While busd is away
        there are none, and the same may come back with it."""
        if self._last != self._last_noted and self._matched:
            self._listeners = self._matched
        self._last_noted = self._last
        self._matched = frozenset(match.gid for match in self.publisher.matches)

    def _is_next(self, samples: Sequence[Sample]) -> bool:
        """Whether they go on where the last ones ended, each once: they nearly always do."""
        number = first = number_and_time(samples, 0)[0]
        last = number_and_time(samples, -1)[0]
        if first != self._last + 1 or last - first != len(samples) - 1:
            return False
        if type(samples) is Packed:
            if not samples.is_consecutive:
                return False
        else:
            for sample in samples:
                if sample[1] != number:
                    return False
                number += 1
        self._last, self._is_fresh = last, False
        return True

    def _without_repeated(self, samples: Sequence[Sample]) -> list[Sample]:
        account, found = self.account, []
        for sample in samples:
            if number := sample.number:
                if self._may_repeat:
                    self._may_repeat, self._last = False, min(self._last, number - 1)
                if number <= self._last:
                    account.drop(REPEATED)
                    continue
                if not self._is_fresh or self._listeners & self._matched:
                    account.lost += number - self._last - 1
                self._last, self._is_fresh = number, False
            found.append(sample)
        return found

    def _without_known(self, samples: Sequence[Sample]) -> list[Sample]:
        for at, sample in enumerate(samples):
            if sample.source_time_ns > self._known_ns or not self._most_known:
                self._most_known = 0
                return [*samples][at:]
            self._most_known -= 1
            self._last, self._is_fresh = sample.number, False
            self.account.drop(REPEATED)
        return []

    def _without_expired(self, samples: Sequence[Sample]) -> Sequence[Sample]:
        now_ns, lateness = monotonic_ns(), self._lateness
        for sample in samples:
            self._note(now_ns, sample.source_time_ns)
        kept = [one for one in samples if lateness.age_ns(now_ns, one.source_time_ns) <= self._lifespan_ns]
        self.account.drop(EXPIRED, len(samples) - len(kept))
        return kept

    def _note(self, now_ns: int, source_ns: int) -> None:
        """The next message of the publisher came."""
        if source_ns < self._newest_ns - _STEP_NS:  # its clock was set back, and what was learned is wrong
            self._lateness.forget()
        self._newest_ns = source_ns
        self._lateness.note(now_ns, source_ns)

    async def _pump_on(self) -> None:
        try:
            while True:
                await self.publisher.wait_for_room()
                if not self._publish_waiting():
                    return
        except ConnectionClosed as error:
            self._fail(error, len(self._waiting))
            self._waiting.clear()
        finally:
            self._pumping = None

    def _publish_waiting(self) -> bool:
        """Returns whether there is no room for the next one."""
        waiting, before, is_full = self._waiting, self._waiting.bytes, False
        while waiting and not is_full:
            batch = waiting.first(_AT_ONCE)
            done = self._publish_all(batch)
            waiting.remove(done)
            is_full = done < len(batch)
        if self._reader is not None and (gone := before - waiting.bytes):
            self._reader.taken(gone)
        return is_full

    def _publish_all(self, samples: Sequence[Sample]) -> int:
        """Publish them. Returns how many of them have gone: a lossless publisher may have no room for all."""
        quick = self._publish_packed(samples) if type(samples) is Packed else 0
        return quick + self._publish_each(samples[quick:]) if quick < len(samples) else quick

    def _publish_packed(self, samples: Packed) -> int:
        """Publish as many as can be without a look at single ones."""
        try:
            done = self.publisher.publish_packed(samples.whole, samples.start)
        except BusError:  # which is met again
            return 0
        self.account.sent += done
        self.account.bytes += samples.payload_bytes
        if done < len(samples):
            self.account.bytes -= samples.after(done).payload_bytes
        return done

    def _publish_each(self, samples: Sequence[Sample]) -> int:
        publish, done, failed, size = self._publish, 0, 0, 0
        for payload, _, source_time_ns in samples:
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
        reason = TOO_LARGE if isinstance(error, PayloadTooLarge) else REFUSED
        self.account.drop(reason, count)
        self.is_broken |= isinstance(error, ConnectionClosed)
        self._on_trouble(str(error))

    def _read(self) -> None:
        try:
            self._reader = self._engine.read(self._endpoint, self._schema, self.receive)
        except Exception as error:
            self._on_trouble(in_words(error))
            self._timer = self._loop.call_later(_RETRY_S, self.look)

    def _stop(self) -> None:
        reader, self._reader = self._reader, None
        if reader is not None:
            self._lost_before = summed(self._lost_before, reader.lost)
            reader.close()
        self._is_fresh = True
