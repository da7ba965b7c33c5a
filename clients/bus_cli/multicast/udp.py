"""UDP datagrams to and from a multicast group."""

import socket
from argparse import ArgumentParser, ArgumentTypeError
from ipaddress import AddressValueError, IPv4Address

from bus_cli.output import CommandError
from bus_cli.stream import positive_int

__all__ = [
    "GROUP",
    "PORT",
    "add_group_arguments",
    "add_ttl_argument",
    "check_group",
    "receiver",
    "send",
    "sender",
]

GROUP = "225.0.0.1"
PORT = 49150
"""As in ROS 2: both tools receive from each other."""

_MOST_PORT, _MOST_TTL = 65535, 255


def add_group_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--group", default=GROUP, help=f"The multicast group address (default: {GROUP})")
    parser.add_argument("--port", type=_port, default=PORT, help=f"The multicast port (default: {PORT})")


def add_ttl_argument(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--ttl", metavar="N", type=_ttl, help="The multicast TTL: most hops to other networks (default: 1)"
    )


def sender(ttl: int | None) -> socket.socket:
    """A socket for `send`."""
    made = _socket()
    if ttl is not None:
        made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, ttl)
    return made


def send(through: socket.socket, data: bytes, group: str, port: int) -> None:
    """Send one datagram. Raises CommandError if the machine has no way to the group."""
    try:
        through.sendto(data, (group, port))
    except OSError as error:
        raise CommandError(f"can't send to {group}:{port}: {error.strerror or error}") from None


def receiver(group: str, port: int) -> socket.socket:
    """A socket that has joined the group. Raises CommandError if this is not possible."""
    check_group(group)
    made = _socket()
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        made.bind(("", port))
        membership = socket.inet_aton(group) + socket.inet_aton("0.0.0.0")
        made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
    except OSError as error:
        made.close()
        raise CommandError(f"can't receive from {group}:{port}: {error.strerror or error}") from None
    return made


def check_group(text: str) -> None:
    """Raises CommandError if it is not the address of a multicast group."""
    try:
        is_group = IPv4Address(text).is_multicast
    except AddressValueError:
        is_group = False
    if not is_group:
        raise CommandError(f"'{text}' is not a multicast group; groups are 224.0.0.0 to 239.255.255.255")


def _socket() -> socket.socket:
    return socket.socket(socket.AF_INET, socket.SOCK_DGRAM, socket.IPPROTO_UDP)


def _port(text: str) -> int:
    """For argparse."""
    return _bounded(text, _MOST_PORT)


def _ttl(text: str) -> int:
    """For argparse."""
    return _bounded(text, _MOST_TTL)


def _bounded(text: str, most: int) -> int:
    if (value := positive_int(text)) > most:
        raise ArgumentTypeError(f"value must be at most {most}")
    return value
