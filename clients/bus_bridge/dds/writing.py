"""The route out of a publisher of this bus: a DDS writer.

Owns: whether a far reader wants messages, and writing them. It never blocks: if DDS has no room, the rest of
a batch waits with the caller.
"""

import asyncio
from collections.abc import Callable
from typing import Final

from bus.vocabulary import DropReason
from bus_bridge.batch import Batch
from bus_bridge.dds import raw
from bus_bridge.dds.known_types import KnownType
from bus_bridge.dds.participant import Participant
from bus_bridge.dds.qos import Policies
from bus_ros.cdr import CdrError

__all__ = ["DdsWriter"]

_FIRST_PAUSE_S: Final = 0.001
_LONGEST_PAUSE_S: Final = 0.02


class DdsWriter:
    """The Writer that `announce_publisher` returns. `is_far` says whether the reader with that handle belongs
    to another program than busd."""

    def __init__(
        self,
        participant: Participant,
        topic: str,
        known: KnownType,
        policies: Policies,
        user_data: bytes,
        on_change: Callable[[], None],
        *,
        is_far: Callable[[int], bool],
        on_close: Callable[["DdsWriter"], None],
    ) -> None:
        self.is_wanted = False
        self.lost: dict[str, int] = {}
        self._on_change = on_change
        self._is_far = is_far
        self._on_close = on_close
        self._encode = known.codec.encode
        self._loop = asyncio.get_running_loop()
        self._last = 0
        self._pause_s = _FIRST_PAUSE_S
        self._timer: asyncio.TimerHandle | None = None
        self._is_closed = False
        self._endpoint = participant.make_writer(
            topic,
            known.idl,
            policies,
            user_data,
            lambda: self._loop.call_soon_threadsafe(self.update_matches),
        )
        self._write = raw.writer_of(self._endpoint.entity)
        self.gid = self._endpoint.guid

    def update_matches(self) -> None:
        """Update the matched readers after a possible change."""
        if self._is_closed:
            return
        is_wanted = any(map(self._is_far, self._endpoint.matched_readers()))
        if is_wanted != self.is_wanted:
            self.is_wanted = is_wanted
            self._on_change()

    def write(self, batch: Batch) -> int:
        if self._is_closed:
            return batch.count
        for gone, (payload, number, time_ns) in enumerate(batch):
            if 0 < number <= self._last:
                continue  # the writer's history has the messages for late joiners already
            try:
                parts = self._encode(payload)
            except CdrError:
                self.lost[DropReason.UNDECODABLE] = self.lost.get(DropReason.UNDECODABLE, 0) + 1
                continue
            size = sum(map(len, parts))
            if padding := -size % 4:
                parts.append(bytes(padding))
            code = self._write(b"".join(parts), time_ns)
            if code == raw.TIMED_OUT:
                self._wait_for_room()
                return gone
            if code < 0:
                self.lost[DropReason.REFUSED] = self.lost.get(DropReason.REFUSED, 0) + 1
            self._last = number
        self._pause_s = _FIRST_PAUSE_S
        return batch.count

    def close(self) -> None:
        if not self._is_closed:
            self._is_closed = True
            self.is_wanted = False
            if self._timer is not None:
                self._timer.cancel()
            self._endpoint.close()
            self._on_close(self)

    def _wait_for_room(self) -> None:
        # DDS does not report acknowledgments of readers. So poll, with growing pauses.
        if self._timer is None:
            self._timer = self._loop.call_later(self._pause_s, self._try_again)
            self._pause_s = min(2 * self._pause_s, _LONGEST_PAUSE_S)

    def _try_again(self) -> None:
        self._timer = None
        self._on_change()
