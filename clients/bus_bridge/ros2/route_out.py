"""The route out of a publisher of this bus, for both carriers of topics.

Owns: which messages are new, their conversion, and waiting for room. It never blocks: if the carrier has no
room, the rest of a batch waits with the caller. Must not know: how a carrier sends.
"""

import asyncio
from collections.abc import Callable
from typing import Final

from bus.vocabulary import DropReason
from bus_bridge.batch import Batch
from bus_bridge.ros2 import samples
from bus_bridge.ros2.known_types import KnownType
from bus_ros.cdr import CdrError

__all__ = ["RouteOut"]

_FIRST_PAUSE_S: Final = 0.001
_LONGEST_PAUSE_S: Final = 0.02


class RouteOut:
    """A TopicWriter. Its class in a carrier defines the methods that raise NotImplementedError here."""

    gid: bytes

    def __init__(
        self, known: KnownType, on_change: Callable[[], None], on_close: Callable[["RouteOut"], object]
    ) -> None:
        self.is_wanted = False
        self.is_closed = False
        self._losses: dict[str, int] = {}
        self._on_change = on_change
        self._on_close = on_close
        self._codec = known.codec
        self._loop = asyncio.get_running_loop()
        self._last = 0
        self._pause_s = _FIRST_PAUSE_S
        self._timer: asyncio.TimerHandle | None = None

    @property
    def lost(self) -> dict[str, int]:
        return self._losses

    def update(self) -> None:
        """Update whether a far reader wants messages, after a possible change."""
        if self.is_closed:
            return
        is_wanted = self._has_reader()
        if is_wanted != self.is_wanted:
            self.is_wanted = is_wanted
            self._on_change()

    def write(self, batch: Batch) -> int:
        if self.is_closed:
            return batch.count
        for gone, (payload, number, time_ns) in enumerate(batch):
            if 0 < number <= self._last:
                continue  # the writer's history has the messages for late joiners already
            try:
                cdr = self._encoded(payload)
            except CdrError:
                self._lose(DropReason.UNDECODABLE)
                continue
            if not self._send(cdr, time_ns):
                self._wait_for_room()
                return gone
            self._last = number
        self._pause_s = _FIRST_PAUSE_S
        return batch.count

    def close(self) -> None:
        if not self.is_closed:
            self.is_closed = True
            self.is_wanted = False
            if self._timer is not None:
                self._timer.cancel()
            self._end()
            self._on_close(self)

    # --- the carrier's part

    def _has_reader(self) -> bool:
        """Whether a far reader is matched."""
        raise NotImplementedError

    def _encoded(self, payload: bytes) -> bytes:
        """The CDR of a message. Raises CdrError."""
        return samples.encode(self._codec, payload)

    def _send(self, cdr: bytes, time_ns: int) -> bool:
        """Send a message; False if there is no room now."""
        raise NotImplementedError

    def _end(self) -> None:
        """End the writer."""
        raise NotImplementedError

    # --- inside

    def _lose(self, reason: DropReason) -> None:
        self._losses[reason] = self._losses.get(reason, 0) + 1

    def _wait_for_room(self) -> None:
        # DDS gives no news of acknowledgments. So poll, with growing pauses.
        if self._timer is None:
            self._timer = self._loop.call_later(self._pause_s, self._try_again)
            self._pause_s = min(2 * self._pause_s, _LONGEST_PAUSE_S)

    def _try_again(self) -> None:
        self._timer = None
        self._on_change()
