"""Connects to a broker's socket: one try, and the rules for retries. The same for all clients.

If the backlog of a UNIX socket is full, a non-blocking connect() returns EAGAIN, and no event reports later
room. So a client retries, soon at first and then less often. It also retries if a broker refuses it for a
temporary reason, or ends while it connects.
"""

import os
import socket
import sys
from collections.abc import Callable, Mapping
from time import monotonic

from bus.errors import BrokerUnavailable
from bus.link.socket_owner import check_server

__all__ = [
    "CONNECT_S",
    "TELL_S",
    "BacklogFull",
    "NotNow",
    "Patience",
    "is_allowed",
    "no_answer",
    "no_answer_yet",
    "open_socket",
    "program_name",
    "try_to_connect",
]

CONNECT_S = 10.0
"""Time for which a client retries, counted from its last progress."""

TELL_S = 5.0
"""A waiting client logs that the broker has been silent for this time."""

_FIRST_PAUSE_S = 0.001
_LONGEST_PAUSE_S = 0.05


class _Socket(socket.socket):
    """A socket that the collector closes without a warning, because the unclosed node has its own warning."""

    __slots__ = ()

    def __del__(self) -> None:
        self.close()


class NotNow(BrokerUnavailable):
    """A temporary failure: retry, with pauses that grow up to `longest_s`."""

    longest_pause_s = _LONGEST_PAUSE_S


class BacklogFull(NotNow):
    """The backlog is full. The broker does not notice retries, so these may follow quickly."""

    longest_pause_s = 0.005


class Patience:
    """The time for retries: `seconds` from its creation, and again from each `renew`."""

    def __init__(self, seconds: float = CONNECT_S, clock: Callable[[], float] = monotonic) -> None:
        self._seconds = seconds
        self._clock = clock
        self.renew()

    def renew(self) -> None:
        """Start the time again, because the client made progress."""
        self._end_s = self._clock() + self._seconds
        self._pause_s = _FIRST_PAUSE_S

    def pause_s(self, why: str, longest_s: float = _LONGEST_PAUSE_S) -> float:
        """The pause before the next try; each time longer, up to `longest_s`.

        When the time is over, raises BrokerUnavailable with `why` and the duration of the tries.
        """
        left_s = self._end_s - self._clock()
        if left_s <= 0:
            raise BrokerUnavailable(f"{why}; tried for {self._seconds:g} s")
        pause_s = min(self._pause_s, longest_s, left_s)
        self._pause_s = min(2 * self._pause_s, _LONGEST_PAUSE_S)
        return pause_s


def no_answer(path: str | os.PathLike[str], seconds: float) -> str:
    """The text for a broker at `path` that accepted the connection and has been silent for this time."""
    return f"busd at {os.fspath(path)} does not answer: it has said nothing for {seconds:g} s"


def no_answer_yet(path: str | os.PathLike[str]) -> str:
    """The text after TELL_S, while the client still waits."""
    return f"busd at {os.fspath(path)} has said nothing for {TELL_S:g} s; still waiting for its answer"


def try_to_connect(path: str | os.PathLike[str]) -> socket.socket:
    """Make a non-blocking socket, connected to the broker at `path`.

    Raises FileNotFoundError or ConnectionRefusedError if no process listens there, BacklogFull if too many
    connections wait to be accepted, and BrokerUnavailable if the socket can't be connected to or is not
    trusted.
    """
    sock = _Socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        sock.setblocking(False)
        sock.connect(os.fspath(path))
        check_server(sock, path)
    except BlockingIOError:
        sock.close()
        raise BacklogFull(f"busd at {path} takes no connection: too many wait to be accepted") from None
    except (FileNotFoundError, ConnectionRefusedError, BrokerUnavailable):
        sock.close()
        raise
    except OSError as error:
        sock.close()
        raise BrokerUnavailable(f"cannot connect to busd at {path}: {error.strerror or error}") from None
    except BaseException:
        sock.close()
        raise
    return sock


def is_allowed(environ: Mapping[str, str] = os.environ) -> bool:
    """Whether a busd may be started: BUSD_AUTOSTART is not 0."""
    return environ.get("BUSD_AUTOSTART", "1") not in ("0", "no", "off", "false")


async def open_socket(
    path: str | os.PathLike[str], patience: Patience, *, may_start: bool = True
) -> socket.socket:
    """Make a non-blocking socket connected to the broker at `path`; start a broker if `may_start`.

    Raises BrokerUnavailable if no broker answers and none may be or could be started, or when `patience`
    ends.
    """
    try:
        return await _connect(path, patience)
    except (FileNotFoundError, ConnectionRefusedError):
        if not may_start:
            raise BrokerUnavailable(f"no busd listens on {path}") from None
        if not is_allowed():
            raise BrokerUnavailable(
                f"no busd listens on {path}; start one with: busd --socket {path}"
                " (or let programs start it: unset BUSD_AUTOSTART)"
            ) from None
    from bus.link.autostart import start

    await start(path)
    patience.renew()
    while True:
        try:
            return await _connect(path, patience)
        except (FileNotFoundError, ConnectionRefusedError):
            # Another process's busd was first: it holds the lock, but may not listen yet.
            why = f"busd was started at {path} but does not answer: nothing listens there"
        await _sleep(patience.pause_s(why))


async def _connect(path: str | os.PathLike[str], patience: Patience) -> socket.socket:
    while True:
        try:
            return try_to_connect(path)
        except NotNow as error:
            pause_s = patience.pause_s(str(error), error.longest_pause_s)
        await _sleep(pause_s)


async def _sleep(pause_s: float) -> None:
    import asyncio  # late: clients without an event loop use the rest of this module

    await asyncio.sleep(pause_s)


def program_name() -> str:
    """The name of this program for busd's lists."""
    return sys.argv[0].rpartition("/")[2][:255] if sys.argv and sys.argv[0] else "python"
