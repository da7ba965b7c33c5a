"""Where the page may be had: on loopback or a unix socket, and nowhere that other machines can reach."""

import ipaddress
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

__all__ = ["DEFAULT", "Place", "PlaceError", "parse_place"]

_MOST_PATH_BYTES = 107
_WHO = "who looks at the bus sees every message, so it is served on loopback or a unix socket only"


class PlaceError(Exception):
    """The text says what is wrong with it, and what would do."""


class Place(NamedTuple):
    """An address of loopback with a port (0: the kernel chooses), or the path of a unix socket."""

    address: str = ""
    port: int = 0
    path: Path | None = None

    @property
    def authority(self) -> str:
        """Address and port as a URL has them. Of a unix socket: those to which ssh forwards it."""
        if self.path is not None:
            return f"127.0.0.1:{DEFAULT.port}"
        return f"[{self.address}]:{self.port}" if ":" in self.address else f"{self.address}:{self.port}"

    @property
    def forwarding(self) -> str:
        """What another machine says to have it there; HOST is this one."""
        port = DEFAULT.port if self.path is not None else self.port
        there = self.path if self.path is not None else self.authority
        return f"ssh -NL {port}:{there} HOST"

    @property
    def cookie(self) -> str:
        """The name of its cookie: browsers keep those of all ports of a machine together."""
        return f"busd_{sha256(str(self.path or self.port).encode()).hexdigest()[:8]}"

    def __str__(self) -> str:
        return self.authority if self.path is None else f"unix:{self.path}"


DEFAULT = Place("127.0.0.1", 8765)


def parse_place(text: str) -> Place:
    """`127.0.0.1:8765`, `[::1]:8765`, `localhost:8765` or `unix:PATH`. Raises PlaceError."""
    kind, colon, path = text.partition(":")
    if kind == "unix" and colon:
        return Place(path=_checked_path(path))
    host, colon, port = text.rpartition(":")
    is_number = port.isascii() and port.isdigit() and int(port[:6]) < 65536
    if not colon or not host or not is_number:
        raise PlaceError(f"{text!r} is neither address:port, such as {DEFAULT}, nor unix:PATH")
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host.strip("[]"))
    except ValueError:
        raise PlaceError(f"{host!r} is no address of loopback: 127.0.0.1, [::1] or localhost") from None
    if not address.is_loopback:
        line = Place("127.0.0.1", int(port) or DEFAULT.port).forwarding
        raise PlaceError(
            f"{host} is not loopback; {_WHO}. For a browser on another machine, say there: {line}"
        )
    return Place(str(address), int(port))


def _checked_path(text: str) -> Path:
    if not text:
        raise PlaceError("unix: without a path; say unix:PATH")
    path = Path(text).expanduser().absolute()
    length = len(str(path).encode())
    if "\0" in text or length > _MOST_PATH_BYTES:
        raise PlaceError(f"a unix socket's path has {_MOST_PATH_BYTES} bytes at most; this one has {length}")
    return path
