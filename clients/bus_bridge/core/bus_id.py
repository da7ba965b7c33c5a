"""The id of a bus, by which bridges tell buses apart: the same after any restart, another for each socket.

It is a host's name and a digest of what tells two buses of such hosts apart: two machines may have one name,
and two containers one boot id.
"""

import os
import re
import socket
import uuid
from hashlib import sha256
from pathlib import Path

from bus.errors import ConfigurationError

__all__ = ["MAX_LENGTH", "checked_id", "find_bus_id", "make_id"]

MAX_LENGTH = 64
_MAX_HOST = 40
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
_RIGHT = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


def make_id(host: str, boot: str, device: int, inode: int, socket_name: str) -> str:
    """The id of the bus with the socket `socket_name` in the directory `inode` of `device`.

    `boot` is new with each start of the machine, and the same in all of its containers.
    """
    name = re.sub(r"[^A-Za-z0-9-]+", "-", host.partition(".")[0])[:_MAX_HOST].strip("-") or "host"
    known = "\0".join((boot, str(device), str(inode), socket_name))
    return f"{name}-{sha256(known.encode(errors='surrogateescape')).hexdigest()[:8]}"


def find_bus_id(path: str) -> str:
    """The id of the bus at the socket `path`. Its directory must exist.

    Raises OSError if it does not.
    """
    folder, name = os.path.split(path)
    status = os.stat(folder)  # noqa: PTH116
    try:
        boot = _BOOT_ID.read_text().strip()
    except OSError:  # no Linux
        boot = f"{uuid.getnode():x}"
    return make_id(socket.gethostname(), boot, status.st_dev, status.st_ino, name)


def checked_id(text: str) -> str:
    """`text`, an id that a user has chosen. Raises ConfigurationError if it can't be one."""
    if len(text) > MAX_LENGTH or not _RIGHT.fullmatch(text):
        raise ConfigurationError(
            "the id of a bus has letters, digits, '-', '_' and '.', begins with a letter or digit, and has "
            f"at most {MAX_LENGTH} characters; it is {text[: MAX_LENGTH + 1]!r}"
        )
    return text
