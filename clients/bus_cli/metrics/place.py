"""Where metrics may be had: a UNIX socket of ours, or loopback. Nothing that other machines can reach.

Owns the words for a place, and its socket and file. Must not know what is served there.
"""

import errno
import ipaddress
import os
import socket
import stat
from argparse import ArgumentTypeError
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from bus.process.address import MAX_PATH_BYTES
from bus_cli.output import CommandError

__all__ = ["Listening", "Place", "parse_place"]

_BACKLOG = 16
_WHY = "metrics name processes and topics, so they are served on loopback or a UNIX socket only"


class Place(NamedTuple):
    """A path, or an address with a port (0: the kernel chooses)."""

    path: Path | None = None
    address: str = ""
    port: int = 0


def parse_place(text: str) -> Place:
    """For argparse: `unix:/path`, `127.0.0.1:9464`, `[::1]:9464`, `localhost:9464`."""
    if text.startswith("unix:"):
        path = Path(text.removeprefix("unix:")).absolute()
        size = len(os.fsencode(path))
        if not text.removeprefix("unix:") or size > MAX_PATH_BYTES:
            raise ArgumentTypeError(
                f"{text!r}: a socket's path has 1 to {MAX_PATH_BYTES} bytes, this one {size}"
            )
        return Place(path=path)
    host, colon, port = text.rpartition(":")
    if not colon or not (port.isascii() and port.isdigit()) or not 0 <= int(port[:6]) < 65536:
        raise ArgumentTypeError(f"{text!r} is neither unix:/path nor address:port, such as 127.0.0.1:9464")
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host.strip("[]"))
    except ValueError:
        raise ArgumentTypeError(f"{host!r} is no address: 127.0.0.1, [::1] or localhost") from None
    if not address.is_loopback:
        raise ArgumentTypeError(f"{host} is not loopback; {_WHY}")
    return Place(address=str(address), port=int(port))


class Listening:
    """A listening socket at `place`; use it as `with`. Raises CommandError where it can't be had.

    A file that a dead one left is replaced, one that answers is not. At the end the file is removed.
    """

    def __init__(self, place: Place) -> None:
        self._path = place.path
        self.socket = _at_path(place.path) if place.path else _at_address(place.address, place.port)
        self._file = None if place.path is None else _identity(place.path)

    @property
    def hosts(self) -> frozenset[str]:
        """What a request may call us. Empty: anything, for only those come who may open our file.

        A page in a browser may reach loopback too, by a name that its owner points there.
        """
        if self._path is not None:
            return frozenset()
        return frozenset({"localhost", _host(self.socket.getsockname()[0])})

    def describe(self) -> str:
        """As a URL, or as curl wants it."""
        if self._path is not None:
            return f"unix:{self._path}"
        address, port, *_ = self.socket.getsockname()
        return f"http://{_host(address)}:{port}/metrics"

    def close(self) -> None:
        if self._path is not None:
            with suppress(OSError):  # somebody has removed it
                if _identity(self._path) == self._file:
                    self._path.unlink()
        self.socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _at_address(address: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((address, port))
        listening.listen(_BACKLOG)
    except OSError as error:
        listening.close()
        other = "; choose another port with --listen" if error.errno == errno.EADDRINUSE else ""
        raise CommandError(f"can't listen on {_host(address)}:{port}: {error.strerror}{other}") from None
    return listening


def _at_path(path: Path) -> socket.socket:
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        _remove_stale(path)
        listening.bind(str(path))
        path.chmod(0o600)  # before listen(), so that nobody could connect in between
        listening.listen(_BACKLOG)
    except OSError as error:
        listening.close()
        raise CommandError(f"can't listen on {path}: {error.strerror}") from None
    except BaseException:
        listening.close()
        raise
    return listening


def _remove_stale(path: Path) -> None:
    try:
        if not stat.S_ISSOCK(path.lstat().st_mode):
            raise CommandError(f"{path} exists and is no socket; it is not replaced")
    except FileNotFoundError:
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink()
            return
        except BlockingIOError:  # its backlog is full
            pass
    raise CommandError(f"somebody listens on {path} already")


def _identity(path: Path) -> tuple[int, int]:
    found = path.lstat()
    return found.st_dev, found.st_ino


def _host(address: str) -> str:
    return f"[{address}]" if ":" in address else address
