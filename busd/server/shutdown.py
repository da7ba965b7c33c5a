"""The orderly end of the connections: samples from peers are routed, data that waits for them is sent.

Owns the order and the bounds of time. Must not know what is sent. A peer that understands Leaving stops
between two frames. From any other peer, busd takes the data in its socket. As long as any peer may still
send, all are served: its samples may be for them.
"""

import asyncio
import logging
from collections.abc import Callable, Collection
from time import monotonic

from bus.transport.stream_state import ReadState
from busd.server.peer import PeerConnection

__all__ = ["Drain"]

_LOOK_S = 0.005
_STEP_S = 0.05
"""At most this much time counts per look: if busd itself was held up, its peers must not pay for it."""

_log = logging.getLogger("busd")


class Drain:
    """Begins at once. `connections` are looked at until all are closed; then `on_end` is called, once.

    `on_poll` is called each time that they are looked at again. `on_heard` is called, at least once, after
    all data from peers was read. `longest_s`: data that peers have not taken by then is left, and the log
    says how much. A peer has half of that time to react to Leaving.
    """

    def __init__(
        self,
        connections: Collection[PeerConnection],
        text: str,
        *,
        longest_s: float,
        on_poll: Callable[[], None],
        on_heard: Callable[[], None],
        on_end: Callable[[], None],
    ) -> None:
        self._connections = connections
        self._on_poll = on_poll
        self._on_heard = on_heard
        self._on_end = on_end
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._longest_s = longest_s
        self._passed_s = 0.0
        self._looked_s = monotonic()
        for connection in tuple(connections):
            connection.leave(text)
        self._poll()

    def end(self) -> None:
        """Wait no longer."""
        self._passed_s = self._longest_s
        if self._timer is not None:
            self._timer.cancel()
        self._poll()

    def _poll_again(self) -> None:
        self._on_poll()
        self._poll()

    def _poll(self) -> None:
        now_s = monotonic()
        self._passed_s += min(now_s - self._looked_s, _STEP_S)
        self._looked_s = now_s
        speakers = [one for one in self._open if one.stream.reading is not ReadState.ENDED]
        if self._passed_s >= self._longest_s / 2:
            for connection in speakers:
                connection.stream.drain_input()
        is_over = self._passed_s >= self._longest_s
        if is_over or not speakers:
            self._on_heard()
            for connection in self._open:
                if is_over or connection.stream.is_drained:
                    _close(connection)
        if self._open:
            self._timer = self._loop.call_later(_LOOK_S, self._poll_again)
        else:
            self._on_end()

    @property
    def _open(self) -> list[PeerConnection]:
        return [one for one in self._connections if one.stream.reading is not ReadState.CLOSED]


def _close(connection: PeerConnection) -> None:
    if not connection.stream.is_drained:
        pid, outbox = connection.credentials.pid, connection.stream.outbox
        _log.warning("pid %d does not read: %d samples were lost", pid, outbox.samples, extra={"peer": pid})
    connection.close()
