"""Where metrics may be had: on loopback, and nowhere that other machines can reach."""

import ipaddress
from argparse import ArgumentTypeError
from typing import NamedTuple

__all__ = ["Place", "parse_place"]

_WHY = "metrics name processes and topics, so they are served on loopback only"


class Place(NamedTuple):
    """An address with a port (0: the kernel chooses)."""

    address: str
    port: int

    @property
    def host(self) -> str:
        """The address as a URL has it."""
        return f"[{self.address}]" if ":" in self.address else self.address


def parse_place(text: str) -> Place:
    """For argparse: `127.0.0.1:9464`, `[::1]:9464`, `localhost:9464`."""
    host, colon, port = text.rpartition(":")
    if not colon or not (port.isascii() and port.isdigit()) or not 0 <= int(port[:6]) < 65536:
        raise ArgumentTypeError(f"{text!r} is not address:port, such as 127.0.0.1:9464")
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host.strip("[]"))
    except ValueError:
        raise ArgumentTypeError(f"{host!r} is no address: 127.0.0.1, [::1] or localhost") from None
    if not address.is_loopback:
        raise ArgumentTypeError(f"{host} is not loopback; {_WHY}")
    return Place(str(address), int(port))
