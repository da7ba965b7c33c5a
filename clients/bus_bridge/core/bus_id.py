"""The id of a bus, by which bridges distinguish buses. It survives restarts, and each socket has another id.

The id is a host name and a digest. The digest is necessary because two machines may have the same name, and
two containers the same boot id.
"""

import os
import re
import socket
import uuid
from hashlib import sha256
from pathlib import Path

__all__ = ["find_bus_id", "make_id"]

_MAX_HOST = 40
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


def make_id(host: str, boot: str, device: int, inode: int, socket_name: str) -> str:
    """The id of the bus with the socket `socket_name` in the directory `inode` of `device`.

    `boot` changes with each start of the machine, and is the same in all of its containers.
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
    except OSError:  # not on Linux
        boot = f"{uuid.getnode():x}"
    return make_id(socket.gethostname(), boot, status.st_dev, status.st_ino, name)
