"""Tells a service manager how the daemon is doing: the sd_notify protocol (sd_notify(3)).

Owns the datagram and its texts. Must not know when they are due. Without a manager that listens, nothing
happens.
"""

import os
import socket
from collections.abc import Mapping

__all__ = ["READY", "STOPPING", "notify", "status"]

READY = "READY=1"
STOPPING = "STOPPING=1"

# READY must get through a queue that is full for a moment; the daemon must not hang on one that stays full.
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


def status(text: str) -> str:
    """The state that sets the line which `systemctl status` shows."""
    return f"STATUS={' '.join(text.split())}"
