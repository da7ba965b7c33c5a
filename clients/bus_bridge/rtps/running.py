"""A participant on the event loop: its sockets, and a timer."""

import asyncio
import os
import time
from collections.abc import Callable
from typing import Final

from bus_bridge.rtps.announcements import EndpointData
from bus_bridge.rtps.client import ClientParticipant
from bus_bridge.rtps.far import USUAL_BOUNDS, Bounds
from bus_bridge.rtps.ids import OUR_VENDOR, PREFIX_BYTES
from bus_bridge.rtps.local import Local
from bus_bridge.rtps.own_announcements import Settings
from bus_bridge.rtps.participant import Events, Participant
from bus_bridge.rtps.policies import RELIABLE, Policies
from bus_bridge.rtps.reach import Reach
from bus_bridge.rtps.reader import Arrived
from bus_bridge.rtps.sockets import Sockets
from bus_bridge.rtps.writer import USUAL, Keeping

__all__ = ["RunningParticipant"]

_PACKET_BYTES: Final = 1400
"""Bytes that fit into one packet of most networks."""
_LONGEST_SLEEP_S: Final = 3600.0
_LOOPBACK: Final = Reach()


class RunningParticipant:
    """A participant in a DDS domain, until `close`.

    Use it on its event loop only. Raises BridgeError if the address of `reach` or the domain is not
    available.
    """

    def __init__(
        self,
        domain: int,
        events: Events,
        is_wanted: Callable[[EndpointData], bool],
        *,
        reach: Reach = _LOOPBACK,
        user_data: bytes = b"enclave=/;",
        bounds: Bounds = USUAL_BOUNDS,
    ) -> None:
        self.loop = asyncio.get_running_loop()
        self._is_deaf = reach.is_off
        self._sockets = Sockets(domain, reach.host, multicast=reach.has_multicast)
        settings = Settings(
            OUR_VENDOR + os.urandom(PREFIX_BYTES - len(OUR_VENDOR)),
            (self._sockets.address,),
            tuple(one for one in reach.called(domain) if one != self._sockets.address),
            is_client=bool(reach.servers),
            user_data=user_data,
            bounds=bounds,
        )
        if not reach.is_local:
            settings = settings._replace(datagram_bytes=_PACKET_BYTES, fragment_bytes=_PACKET_BYTES - 200)
        make = ClientParticipant if settings.is_client else Participant
        self.core = make(settings, self._sockets.send, events, is_wanted)
        self._timer: asyncio.TimerHandle | None = None
        self._timer_at_s = 0.0
        self._is_closed = False
        self.core.start(time.monotonic_ns())
        for descriptor in self._sockets.descriptors:
            self.loop.add_reader(descriptor, self._receive, descriptor)
        self._plan()

    @property
    def prefix(self) -> bytes:
        """Its part of all GUIDs of ours."""
        return self.core.prefix

    @property
    def unsent(self) -> int:
        """Datagrams that could not be sent; their samples are sent again if a far reader asks."""
        return self._sockets.dropped

    def add_writer(
        self,
        topic: str,
        type_name: str,
        *,
        policies: Policies = RELIABLE,
        user_data: bytes = b"",
        keeping: Keeping = USUAL,
    ) -> Local:
        """Make a writer, and announce it."""
        self._gather()
        made = self.core.add_writer(
            topic,
            type_name,
            time.monotonic_ns(),
            policies=policies,
            user_data=user_data,
            keeping=keeping,
        )
        self._plan()
        return made

    def add_reader(
        self,
        topic: str,
        type_name: str,
        deliver: Callable[[Arrived], None],
        *,
        policies: Policies = RELIABLE,
        user_data: bytes = b"",
    ) -> Local:
        """Make a reader, and announce it. `deliver` must not raise."""
        self._gather()
        made = self.core.add_reader(
            topic, type_name, deliver, time.monotonic_ns(), policies=policies, user_data=user_data
        )
        self._plan()
        return made

    def write(
        self, local: Local, payload: bytes, *, inline: bytes = b"", to: bytes | None = None, time_ns: int = 0
    ) -> int:
        """Write a sample; returns its number. `to`: the GUID of the only reader that gets it.

        `time_ns`: its time of publication; 0: now.
        """
        self._gather()
        now_ns = time.monotonic_ns()
        number = self.core.write(local, payload, now_ns, time_ns or time.time_ns(), inline=inline, to=to)
        self._plan()
        return number

    def remove(self, local: Local) -> None:
        """End a reader or writer. A second call has no effect."""
        if not self._is_closed:
            self._gather()
            self.core.remove(local, time.monotonic_ns())
            self._plan()

    def ask_for_heartbeat(self, reader: bytes, writer: bytes) -> None:
        """As `Participant.ask_for_heartbeat`. No effect after `close`."""
        if not self._is_closed:
            self.core.ask_for_heartbeat(reader, writer)

    def endpoints_of(self, topic: str) -> list[EndpointData]:
        """Far endpoints of a wanted topic."""
        return list(self.core.far.of_topic(topic).values())

    def close(self) -> None:
        """Tell the others, and end. A second call has no effect."""
        if self._is_closed:
            return
        self._is_closed = True
        if self._timer is not None:
            self._timer.cancel()
        for descriptor in self._sockets.descriptors:
            self.loop.remove_reader(descriptor)
        self.core.flush()
        self.core.leave(time.monotonic_ns())
        self._sockets.close()

    def _gather(self) -> None:
        """Send at the end of this turn of the event loop, in few datagrams."""
        if not self.core.gathers and not self._is_closed:
            self.core.gathers = True
            self.loop.call_soon(self._flush)

    def _flush(self) -> None:
        if not self._is_closed:
            self.core.flush()

    def _receive(self, descriptor: int) -> None:
        now_ns = time.monotonic_ns()
        self._sockets.receive(
            descriptor,
            lambda datagram, source: None if self._is_deaf else self.core.receive(datagram, source, now_ns),
        )
        self._plan()

    def _act(self) -> None:
        self._timer = None
        try:
            self.core.act(time.monotonic_ns())
        finally:
            self._plan()  # else an error would end all heartbeats, repairs and requests

    def _plan(self) -> None:
        """Set the timer to what is due next."""
        if self._is_closed:
            return
        due_ns = self.core.due_ns
        wait_s = _LONGEST_SLEEP_S if due_ns is None else max(due_ns - time.monotonic_ns(), 0) / 1e9
        at_s = self.loop.time() + wait_s
        if self._timer is not None:
            if self._timer_at_s <= at_s:
                return  # it looks again then
            self._timer.cancel()
        self._timer_at_s = at_s
        self._timer = self.loop.call_at(at_s, self._act)
