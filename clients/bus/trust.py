"""Whose socket and folder a program may use without having been told to.

By default busd's socket is in a folder of the user's own. Under /tmp anybody may have made that before us,
and would then get all that we send. Owns these two checks; where the user has named a path, it is his choice.
"""

import os
import socket
import stat
import struct
from pathlib import Path

from bus.address import is_default_folder
from bus.errors import BrokerUnavailable

__all__ = ["check_folder", "check_server"]

_UCRED = struct.Struct("=iII")


def check_server(sock: socket.socket, path: Path) -> None:
    """Raises BrokerUnavailable where a default `path` is served by another user than this one and root.

    `sock` is connected, and nothing was sent yet.
    """
    if not hasattr(socket, "SO_PEERCRED"):
        return
    _, uid, _ = _UCRED.unpack(sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size))
    if uid not in (0, os.geteuid()) and is_default_folder(path.parent):
        raise BrokerUnavailable(
            f"{path} is served by user {uid}, who should not be there; nothing was sent "
            "(where you mean to use his busd, set BUSD_SOCKET)"
        )


def check_folder(folder: Path) -> None:
    """Raises BrokerUnavailable where a default `folder` is not one that only this user can write to."""
    if not is_default_folder(folder):
        return
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid() or found.st_mode & 0o022:
        raise BrokerUnavailable(
            f"no busd is started in '{folder}': it is no folder of user {os.geteuid()} alone (owner: user "
            f"{found.st_uid}, mode {stat.filemode(found.st_mode)}); remove it, or set BUSD_SOCKET"
        )
