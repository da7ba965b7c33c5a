"""The taps of one topic and type: subscriptions that take messages of this bus for far subscriptions.

Decides when a tap's messages are taken, and remembers publishers that lossless taps hold back. Must not know
the receiver of messages.
"""

import asyncio
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from bus.subscription import Subscription
from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.core.pace import GATHER_S, Pace
from bus_bridge.engine import LONG_BYTES, LONG_PACK_BYTES, PACK_BYTES
from bus_bridge.packed import Packed

__all__ = ["Taps"]

_BATCH = 256
_new_sample: Any = tuple.__new__

Tap = Subscription[Any]


class Taps:
    """All taps of one topic and type. `on_batch` is called with a tap, a publisher's gid, and its
    messages."""

    def __init__(self, on_batch: Callable[[Tap, bytes, Batch], None]) -> None:
        self.opening = asyncio.Lock()
        """Held while taps are made or closed."""
        self.full: set[bytes] = set()
        """Lossless publishers that are held back, by gid."""
        self._on_batch = on_batch
        self._taps: list[Tap] = []
        self._due: set[Tap] = set()
        self._loop = asyncio.get_running_loop()

    def __iter__(self) -> Iterator[Tap]:
        return iter(self._taps)

    def __bool__(self) -> bool:
        return bool(self._taps)

    @property
    def has_news(self) -> bool:
        """Whether a tap has messages that are not taken yet."""
        return any(tap.statistics().queued for tap in self._taps)

    def replace(self, taps: list[Tap]) -> list[Tap]:
        """Use these taps from now on. Returns the former taps; their messages are no longer taken."""
        before, self._taps = self._taps, taps
        return before

    def begin(self) -> None:
        """Take the present messages of the taps, and all later ones."""
        for tap in self._taps:
            for gid in self.full if tap.qos.is_lossless else ():
                tap.hold_back(gid)
            is_lossless = tap.qos.is_lossless
            tap.set_arrival_callback(
                partial(self._arrive, tap, Pace()) if is_lossless else partial(self.take, tap)
            )
            self.take(tap)

    def take(self, tap: Tap) -> None:
        """Take messages that have arrived."""
        pack = tap.take_packed(PACK_BYTES, LONG_BYTES) or tap.take_packed(LONG_PACK_BYTES, LONG_PACK_BYTES)
        if pack is not None:
            if pack.has_more:
                self._take_on(tap)  # continue later, after other callbacks
            self._on_batch(tap, pack.publisher_gid, Packed.taken(pack))
            return
        batch = tap.take_many(_BATCH)
        if not batch:
            return
        if len(batch) == _BATCH:
            self._take_on(tap)  # continue later, after other callbacks
        groups: dict[bytes, list[Sample]] = {}
        gid: bytes | None = None
        add: Callable[[Sample], None]
        for payload, info in batch:
            if info[4] is not gid:
                gid = info[4]
                add = groups.setdefault(gid, []).append
            add(_new_sample(Sample, (payload, info[2], info[0])))
        for gid, samples in groups.items():
            self._on_batch(tap, gid, Loose(samples))

    # --- lossless publishers wait if there is no room for their messages

    def hold_back(self, gid: bytes) -> None:
        """Stop taking messages of a publisher, because there is no room for them."""
        self.full.add(gid)
        for tap in self._taps:
            if tap.qos.is_lossless:
                tap.hold_back(gid)

    def release(self, gid: bytes) -> None:
        """Take messages of a publisher again, because there is room."""
        self.full.discard(gid)
        for tap in self._taps:
            if tap.qos.is_lossless:
                tap.release(gid)

    # --- times at which messages are taken

    def _arrive(self, tap: Tap, pace: Pace) -> None:
        """Decide when to take a message that has arrived at a lossless tap."""
        if pace.is_gathering:
            return
        if pace.leaves(self._loop.time()):
            self.take(tap)
        else:
            self._loop.call_later(GATHER_S, self._take_gathered, tap, pace)

    def _take_gathered(self, tap: Tap, pace: Pace) -> None:
        pace.gathered(self._loop.time())
        if tap in self._taps:
            self.take(tap)

    def _take_on(self, tap: Tap) -> None:
        if tap not in self._due:
            self._due.add(tap)
            self._loop.call_soon(self._take_now, tap)

    def _take_now(self, tap: Tap) -> None:
        self._due.discard(tap)
        if tap in self._taps:
            self.take(tap)
