"""Checks the owner of a socket, and the folder of busd's files.

The default socket of busd is in a private folder of the user. Under /tmp, another user may have made this
folder first, and would then receive all our messages. Owns these two checks. If the user named a path, the
owner of its socket is the user's choice.
"""

import os
import socket
import stat
import struct
from typing import TYPE_CHECKING

from bus.errors import BrokerUnavailable, ConfigurationError
from bus.process.address import is_default_folder

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["check_server", "prepare_folder"]

_UCRED = struct.Struct("=iII")


def check_server(sock: socket.socket, path: str | os.PathLike[str]) -> None:
    """Raise BrokerUnavailable if another user, except root, serves a default `path`.

    `sock` is connected, and nothing was sent yet.
    """
    if not hasattr(socket, "SO_PEERCRED"):
        return
    _, uid, _ = _UCRED.unpack(sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size))
    if uid in (0, os.geteuid()):
        return
    from pathlib import Path

    if is_default_folder(Path(path).parent):
        raise BrokerUnavailable(
            f"{path} is served by user {uid}, who should not be there; nothing was sent "
            "(to use the busd of that user, set BUSD_SOCKET)"
        )


def prepare_folder(folder: "Path", *, is_default: bool, may_enter: int = 0) -> None:
    """Make the default folder if it is missing; refuse a folder in which another user could replace busd's
    files.

    Any other folder must exist. The default one must be a real folder of this user, and its permissions for
    other users must not exceed `may_enter`. A folder that the user named may have any permissions, if its
    owner is this user or root; a symbolic link to it is followed.

    Raises ConfigurationError with the reason.
    """
    try:
        above = folder.absolute().parent.stat()
        if is_default and not os.path.lexists(folder):
            _check_above(folder, above)
            folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat() if is_default else folder.stat()
    except FileNotFoundError as error:
        hint = f"'{folder.parent}' is not there" if is_default else "make the folder, or choose another path"
        raise ConfigurationError(f"no socket can be made in '{folder}': {error.strerror}; {hint}") from None
    except OSError as error:
        raise ConfigurationError(f"no socket can be made in '{folder}': {error.strerror}") from None
    # From here on no other user can replace the folder: this user owns it, and its entry in the folder above.
    distrust = _distrust(found, is_default=is_default, may_enter=may_enter)
    if distrust is None and is_default and _is_open_to_all(above):
        distrust = "anybody can exchange it: the folder above is world-writable without the sticky bit"
    if distrust is not None:
        owner = f"uid {found.st_uid}, mode {stat.S_IMODE(found.st_mode):04o}"
        raise ConfigurationError(f"busd refuses to open its socket in '{folder}' (owner {owner}): {distrust}")


def _check_above(folder: "Path", above: os.stat_result) -> None:
    """Refuse to make a user's folder as root with that user's environment: it would belong to root."""
    us = os.geteuid()
    if above.st_uid not in (0, us) and not above.st_mode & stat.S_ISVTX:
        raise ConfigurationError(
            f"busd makes no folder '{folder}' as uid {us}: the folder above belongs to uid {above.st_uid}; "
            "unset XDG_RUNTIME_DIR, or choose another path"
        )


def _distrust(folder: os.stat_result, *, is_default: bool, may_enter: int) -> str | None:
    us = os.geteuid()
    if stat.S_ISLNK(folder.st_mode):
        return "it is a symbolic link"
    if not stat.S_ISDIR(folder.st_mode):
        return "it is not a folder"
    if folder.st_uid != us and (is_default or folder.st_uid != 0):
        return f"it belongs to another user than uid {us}"
    if is_default and folder.st_mode & 0o077 & ~may_enter:
        return "others may enter it; if you trust what is in it, chmod 700 it"
    if _is_open_to_all(folder):
        return "every user can replace files in it: it is world-writable without the sticky bit"
    return None


def _is_open_to_all(folder: os.stat_result) -> bool:
    return bool(folder.st_mode & stat.S_IWOTH) and not folder.st_mode & stat.S_ISVTX
