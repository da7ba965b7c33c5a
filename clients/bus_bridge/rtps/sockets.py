"""The UDP socket of a participant, and the one for its multicast group."""

import errno
import socket
from collections.abc import Callable
from typing import Final

from bus_bridge.errors import BridgeError
from bus_bridge.rtps.parameters import Address

__all__ = ["GROUP", "Sockets", "discovery_port", "multicast_port"]

GROUP: Final = "239.255.0.1"

_PORT_BASE: Final = 7400
_PORTS_OF_DOMAIN: Final = 250
_FIRST_OF_PARTICIPANTS: Final = 10
_MOST_PARTICIPANTS: Final = 100
_BUFFER_BYTES: Final = 4 << 20
_MOST_AT_ONCE: Final = 64
"""Datagrams read in one turn of the event loop."""
_LONGEST: Final = 65_536


def multicast_port(domain: int) -> int:
    return _PORT_BASE + _PORTS_OF_DOMAIN * domain


def discovery_port(domain: int, index: int) -> int:
    """The port of the participant with that number on its machine."""
    return multicast_port(domain) + _FIRST_OF_PARTICIPANTS + 2 * index


class Sockets:
    """The sockets of one participant on the interface with the IPv4 address `host`.

    Raises BridgeError if the address is not of this machine, or all ports of the domain are taken.
    """

    def __init__(self, domain: int, host: str, *, multicast: bool) -> None:
        self.dropped = 0
        """Datagrams that could not be sent: the kernel's buffer was full, or the address can't be
        reached."""
        self._unicast, port = _bind(domain, host)
        self.address: Address = host, port
        self._all = [self._unicast]
        if multicast:
            try:
                self._all.append(_join(domain, host))
                self._unicast.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(host))
                self._unicast.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
            except OSError as error:
                self.close()
                raise BridgeError(
                    f"the interface {host} can't join the multicast group {GROUP}: {error.strerror}"
                ) from None

    @property
    def descriptors(self) -> list[int]:
        return [one.fileno() for one in self._all]

    def send(self, address: Address, datagram: bytes) -> None:
        """Send a datagram, or count it as dropped. Never blocks."""
        try:
            self._unicast.sendto(datagram, address)
        except OSError:
            self.dropped += 1

    def receive(self, descriptor: int, take: Callable[[bytes, Address], None]) -> None:
        """Pass the datagrams that wait at one of the descriptors, up to a limit."""
        one = next(one for one in self._all if one.fileno() == descriptor)
        for _ in range(_MOST_AT_ONCE):
            try:
                datagram, source = one.recvfrom(_LONGEST)
            except OSError:  # nothing more, or news of an address that can't be reached
                return
            take(datagram, source)

    def close(self) -> None:
        for one in self._all:
            one.close()


def _bind(domain: int, host: str) -> tuple[socket.socket, int]:
    for index in range(_MOST_PARTICIPANTS):
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        port = discovery_port(domain, index)
        try:
            made.bind((host, port))
        except OSError as error:
            made.close()
            if error.errno != errno.EADDRINUSE:
                raise BridgeError(f"can't receive at {host}:{port}: {error.strerror}") from None
            continue
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        return made, port
    raise BridgeError(f"all {_MOST_PARTICIPANTS} ports of participants in DDS domain {domain} are taken")


def _join(domain: int, host: str) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        made.bind((GROUP, multicast_port(domain)))
        group = socket.inet_aton(GROUP) + socket.inet_aton(host)
        made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
    except OSError:
        made.close()
        raise
    return made
