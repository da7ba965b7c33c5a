"""Tells a service manager how the daemon is doing: the sd_notify protocol (sd_notify(3)).

Owns the datagram and its texts. Must not know when they are due. Without a manager that listens, nothing
happens.
"""

import os
import socket
from collections.abc import Mapping

__all__ = ["ALIVE", "READY", "STOPPING", "notify", "reloading", "status", "watchdog_s"]

READY = "READY=1"
STOPPING = "STOPPING=1"
ALIVE = "WATCHDOG=1"

# READY must get through a queue that is full for a moment; a queue that stays full must not hang the daemon.
_SEND_TIMEOUT_S = 1.0


def notify(state: str, environ: Mapping[str, str] = os.environ) -> bool:
    """Send `state`, one `KEY=value` a line, to $NOTIFY_SOCKET; whether it was sent.

    Never raises: a manager that is absent or gone is no fault of the daemon's.
    """
    address = environ.get("NOTIFY_SOCKET", "")
    if not address.startswith(("/", "@")):
        return False
    # "@" stands for the NUL byte that begins the name of an abstract socket.
    target = b"\0" + os.fsencode(address[1:]) if address[0] == "@" else os.fsencode(address)
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.settimeout(_SEND_TIMEOUT_S)
            sender.sendto(state.encode(errors="replace"), target)
    except OSError:
        return False
    return True


def reloading(now_ns: int) -> str:
    """The state of a daemon that reloads or restarts, since `now_ns`. READY ends it.

    `now_ns` is of CLOCK_MONOTONIC.
    """
    return f"RELOADING=1\nMONOTONIC_USEC={now_ns // 1000}"


def watchdog_s(environ: Mapping[str, str] = os.environ) -> float | None:
    """Within how many seconds the manager wants ALIVE from this process, or None if it does not watch."""
    microseconds, pid = environ.get("WATCHDOG_USEC", ""), environ.get("WATCHDOG_PID", "")
    if not (microseconds.isascii() and microseconds.isdigit()) or pid not in ("", str(os.getpid())):
        return None
    return int(microseconds) / 1e6 or None


def status(text: str) -> str:
    """The state that sets the line which `systemctl status` shows."""
    return f"STATUS={' '.join(text.split())}"
