"""The path of busd's socket, the same for daemon, library and tools.

Pure: computes a path from its arguments and must not touch the file system. The process that listens makes
the folder, and checks its owner.
"""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

from bus.errors import ConfigurationError, StartError

if TYPE_CHECKING:  # its import takes a while, and a program that only uses the bus doesn't need it
    from pathlib import Path

__all__ = ["MAX_DOMAIN", "MAX_PATH_BYTES", "domain_id", "is_default_folder", "socket_name", "socket_path"]

MAX_DOMAIN = 65535
MAX_PATH_BYTES = 107
"""sun_path of struct sockaddr_un has 108 bytes, one of them for the final NUL (unix(7))."""


def socket_path(
    socket: str | os.PathLike[str] | None = None,
    domain: int | None = None,
    *,
    environ: Mapping[str, str] = os.environ,
    uid: int | None = None,
) -> "Path":
    """`socket_name`, as a Path."""
    from pathlib import Path

    return Path(socket_name(socket, domain, environ=environ, uid=uid))


def socket_name(
    socket: str | os.PathLike[str] | None = None,
    domain: int | None = None,
    *,
    environ: Mapping[str, str] = os.environ,
    uid: int | None = None,
) -> str:
    """The absolute path of the socket: `socket`, else $BUSD_SOCKET, else the domain's path.

    The domain's path is $XDG_RUNTIME_DIR/busd/<domain>.sock, or /tmp/busd-<uid>/<domain>.sock if that
    variable is not set. `uid` defaults to this process's user. An empty variable counts as not set.

    Raises ConfigurationError for a path too long for a socket, and for a domain out of range. If the value is
    from a variable, it raises StartError.
    """
    if socket is not None:
        return _checked(_absolute(os.fspath(socket)), ConfigurationError)
    if chosen := environ.get("BUSD_SOCKET"):
        return _checked(_absolute(chosen), StartError)
    runtime = environ.get("XDG_RUNTIME_DIR", "")
    # The XDG specification: a relative path is invalid and must be ignored.
    if runtime.startswith("/"):
        folder = _normal(f"{runtime}/busd")
    else:
        folder = f"/tmp/busd-{os.getuid() if uid is None else uid}"
    return _checked(f"{folder}/{domain_id(domain, environ=environ)}.sock", StartError)


def is_default_folder(
    folder: "Path", environ: Mapping[str, str] = os.environ, uid: int | None = None
) -> bool:
    """Whether `folder` is the default folder, and not named by the user."""
    rest = {name: value for name, value in environ.items() if name != "BUSD_SOCKET"}
    try:
        return folder == socket_path(domain=0, environ=rest, uid=uid).parent
    except ConfigurationError:  # too long for a socket, so there is no default
        return False


def domain_id(domain: int | None = None, *, environ: Mapping[str, str] = os.environ) -> int:
    """The domain, which separates the systems of one host: `domain`, else $BUSD_DOMAIN, else 0.

    Raises ConfigurationError if it is not from 0 to 65535; for the variable, StartError.
    """
    if domain is not None:
        if isinstance(domain, bool) or not isinstance(domain, int) or not 0 <= domain <= MAX_DOMAIN:
            raise ConfigurationError(f"domain must be an integer from 0 to {MAX_DOMAIN}, not {domain!r}")
        return domain
    text = environ.get("BUSD_DOMAIN", "").strip()
    if not text:
        return 0
    # int() refuses very long numbers, so the length is checked first.
    number = int(text) if text.isascii() and text.isdigit() and len(text) <= 16 else -1
    if not 0 <= number <= MAX_DOMAIN:
        raise StartError(f"BUSD_DOMAIN must be an integer from 0 to {MAX_DOMAIN}, not '{text}'")
    return number


def _normal(path: str) -> str:
    """A path in the form of `Path`: without empty parts and dots. `..` stays: its target depends on links."""
    root = "/" if path.startswith("/") else ""
    return root + "/".join(part for part in path.split("/") if part not in ("", "."))


def _absolute(name: str) -> str:
    return _normal(name if name.startswith("/") else f"{os.getcwd()}/{name}")  # noqa: PTH109


def _checked(path: str, error: type[ConfigurationError]) -> str:
    encoded = os.fsencode(path)
    if b"\0" in encoded:
        raise error(f"the path of busd's socket must not contain a NUL byte: {path!r}")
    if len(encoded) > MAX_PATH_BYTES:
        raise error(
            f"the path of busd's socket has {len(encoded)} bytes, but a socket's path may have at most "
            f"{MAX_PATH_BYTES}: '{path}'; choose a shorter one with --socket or BUSD_SOCKET"
        )
    return path
