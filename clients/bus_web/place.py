"""Places to listen at: loopback or a unix socket, never an address that other machines can reach."""

import ipaddress
import os
from argparse import ArgumentTypeError
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

__all__ = ["DEFAULT", "Place", "parse_address", "parse_place"]

_MOST_PATH_BYTES = 107
_COOKIES = 64
_WHY = "viewers see every message of the bus, so it is served only on loopback or a unix socket"


class Place(NamedTuple):
    """An address of loopback with a port (0: the kernel chooses), or the path of a unix socket."""

    address: str = ""
    port: int = 0
    path: Path | None = None

    @property
    def host(self) -> str:
        """The address as a URL has it."""
        return f"[{self.address}]" if ":" in self.address else self.address

    @property
    def authority(self) -> str:
        """Host and port as a URL has them. For a unix socket: the host and port to which ssh forwards it."""
        return f"127.0.0.1:{DEFAULT.port}" if self.path is not None else f"{self.host}:{self.port}"

    @property
    def forwarding(self) -> str:
        """The command that makes the place reachable on another machine; HOST is this machine."""
        port = DEFAULT.port if self.path is not None else self.port
        there = self.path if self.path is not None else self.authority
        return f"ssh -NL {port}:{there} HOST"

    @property
    def cookie(self) -> str:
        """The name of its cookie. Browsers keep the cookies of all ports of a machine together.

        Servers on any port share a few names, or a browser would send more of them than one header holds.
        """
        if self.path is not None:
            return f"busd_{sha256(os.fsencode(self.path)).hexdigest()[:8]}"
        return f"busd_{self.port % _COOKIES}"

    def __str__(self) -> str:
        return self.authority if self.path is None else f"unix:{self.path}"


DEFAULT = Place("127.0.0.1", 8765)


def parse_place(text: str) -> Place:
    """For argparse: `127.0.0.1:8765`, `[::1]:8765`, `localhost:8765` or `unix:PATH`."""
    kind, colon, path = text.partition(":")
    if kind == "unix" and colon:
        return Place(path=_checked_path(path))
    return parse_address(text, DEFAULT, _WHY, or_path=True)


def parse_address(text: str, default: Place, why: str, *, or_path: bool = False) -> Place:
    """An address of loopback with a port. Raises ArgumentTypeError, as argparse wants it.

    Its text says `why` no other address will do, and that a path would (`or_path`).
    """
    host, colon, port = text.rpartition(":")
    is_number = port.isascii() and port.isdigit() and len(port) < 6 and int(port) < 65536
    if not colon or not host or not is_number:
        wanted = f"address:port, such as {default}"
        raise ArgumentTypeError(
            f"{text!r} is neither {wanted}, nor unix:PATH" if or_path else f"{text!r} is not {wanted}"
        )
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host.strip("[]"))
    except ValueError:
        raise ArgumentTypeError(
            f"{host!r} is not a loopback address: 127.0.0.1, [::1] or localhost"
        ) from None
    if not address.is_loopback:
        forwarding = Place("127.0.0.1", int(port) or default.port).forwarding
        raise ArgumentTypeError(f"{host} is not loopback; {why}. On the other machine, run: {forwarding}")
    return Place(str(address), int(port))


def _checked_path(text: str) -> Path:
    if not text:
        raise ArgumentTypeError("unix: without a path; write unix:PATH")
    try:
        path = Path(text).expanduser().absolute()
    except RuntimeError:
        raise ArgumentTypeError(f"unix:{text}: there is no such user") from None
    if not str(path).isprintable():
        raise ArgumentTypeError(f"unix:{text!r}: its path has characters that can't be printed")
    length = len(os.fsencode(path))
    if length > _MOST_PATH_BYTES:
        raise ArgumentTypeError(
            f"a unix socket's path has {_MOST_PATH_BYTES} bytes at most; this one has {length}"
        )
    return path
