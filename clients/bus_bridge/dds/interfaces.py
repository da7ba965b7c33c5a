"""Checks a network interface chosen by the user. Otherwise cyclonedds would report a fault in its own
words."""

import fcntl
import ipaddress
import socket
import struct

from bus_bridge.errors import BridgeError

__all__ = ["LOOPBACK", "address_of", "check_interface", "is_address"]

LOOPBACK = "127.0.0.1"

_GET_FLAGS = 0x8913  # SIOCGIFFLAGS
_GET_ADDRESS = 0x8915  # SIOCGIFADDR
_IS_UP = 1
_ADDRESS_AT = 20
"""The address's place in the answer: after the name, the family and the port."""


def is_address(text: str) -> bool:
    """Whether `text` is an address, not a name."""
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return True


def check_interface(interface: str) -> None:
    """Raises BridgeError if this machine has no such interface, by name or address, or if it is down."""
    if is_address(interface):
        family = socket.AF_INET6 if ":" in interface else socket.AF_INET
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind((interface, 0))
            except OSError:
                raise BridgeError(
                    f"--interface {interface}: no network interface of this machine has that address"
                ) from None
        return
    names = [name for _, name in socket.if_nameindex()]
    if interface not in names:
        raise BridgeError(
            f"--interface {interface}: there is no such network interface; there are "
            + ", ".join(sorted(names))
        )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        flags = struct.unpack_from("H", fcntl.ioctl(probe, _GET_FLAGS, _request(interface)), 16)[0]
        if not flags & _IS_UP:
            raise BridgeError(f"--interface {interface}: that network interface is down")
    address_of(interface)


def address_of(interface: str) -> str:
    """The IPv4 address of an interface, by name or address. Raises BridgeError without one."""
    if is_address(interface):
        if ":" in interface:
            raise BridgeError(f"--interface {interface}: services of ROS 2 need an IPv4 address")
        return interface
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            found = fcntl.ioctl(probe, _GET_ADDRESS, _request(interface))
        except OSError:
            raise BridgeError(
                f"--interface {interface}: that network interface has no IPv4 address"
            ) from None
    return socket.inet_ntoa(found[_ADDRESS_AT : _ADDRESS_AT + 4])


def _request(interface: str) -> bytes:
    return struct.pack("16s240x", interface.encode())
