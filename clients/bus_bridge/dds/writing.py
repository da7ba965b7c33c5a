"""The route out of a publisher of this bus by cyclonedds: a DDS writer."""

from collections.abc import Callable

from bus.vocabulary import DropReason
from bus_bridge.dds import raw
from bus_bridge.dds.participant import Participant
from bus_bridge.ros2.known_types import KnownType
from bus_bridge.ros2.route_out import RouteOut
from bus_bridge.rtps.policies import Policies

__all__ = ["DdsWriter"]


class DdsWriter(RouteOut):
    """Made by `CycloneCarrier.make_writer`. `is_far` says whether the reader with that handle belongs to
    another program than busd."""

    def __init__(
        self,
        participant: Participant,
        topic: str,
        known: KnownType,
        policies: Policies,
        user_data: bytes,
        on_change: Callable[[], None],
        on_close: Callable[[RouteOut], object],
        *,
        is_far: Callable[[int], bool],
    ) -> None:
        super().__init__(known, on_change, on_close)
        self._is_far = is_far
        self._endpoint = participant.make_writer(
            topic, known.idl, policies, user_data, lambda: self._loop.call_soon_threadsafe(self.update)
        )
        self._write = raw.writer_of(self._endpoint.entity)
        self.gid = self._endpoint.guid

    def _has_reader(self) -> bool:
        return any(map(self._is_far, self._endpoint.matched_readers()))

    def _send(self, cdr: bytes, time_ns: int) -> bool:
        code = self._write(cdr, time_ns)
        if code < 0 and code != raw.TIMED_OUT:
            self._lose(DropReason.REFUSED)
        return code != raw.TIMED_OUT

    def _end(self) -> None:
        self._endpoint.close()
