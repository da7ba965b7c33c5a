"""The user's options for the DDS side of a bridge."""

import ipaddress
from importlib.util import find_spec
from typing import Final, Literal

import msgspec

from bus_bridge.errors import BridgeError
from bus_bridge.ros2.domain import MAX_DOMAIN, chosen_domain
from bus_bridge.rtps.reach import DiscoveryRange

__all__ = [
    "CarrierName",
    "DdsOptions",
    "Distro",
    "checked_interface",
    "checked_peer",
    "far_of",
    "parse_server",
]

Distro = Literal["auto", "humble"]
CarrierName = Literal["auto", "cyclonedds", "rtps"]

_SERVER_PORT: Final = 11811
"""The port of the first Discovery Server of a machine, if no other is chosen."""


class DdsOptions(msgspec.Struct, frozen=True):
    """Location of ROS 2. `check` checks the values."""

    domain_id: int | None = None
    """None: $ROS_DOMAIN_ID, or 0."""
    interface: str = ""
    """Name or address of a network interface; empty: only this machine."""
    peers: tuple[str, ...] = ()
    """Addresses of machines beyond the reach of multicast."""
    distro: Distro = "auto"
    """`humble`: nodes of this bus are listed in Humble's form, which later distros can't read. `auto`: in the
    form of the first ROS 2 participant, or the newer form if there is none."""
    carrier: CarrierName = "auto"
    """The carrier of topics: cyclonedds, or the RTPS of busd. `auto`: cyclonedds if it is installed and there
    are no `servers`."""
    discovery: DiscoveryRange = "SUBNET"
    """How far the bridge looks for ROS 2's nodes, within the reach of `interface`."""
    servers: tuple[str, ...] = ()
    """Discovery Servers of Fast DDS, with or without a port. With any, they tell of all nodes."""

    @property
    def carrier_used(self) -> CarrierName:
        """The carrier to use: `cyclonedds` or `rtps`."""
        if self.carrier != "auto":
            return self.carrier
        if self.servers:
            return "rtps"  # only Fast DDS and the RTPS of busd know them
        return "cyclonedds" if find_spec("cyclonedds") is not None else "rtps"

    @property
    def domain(self) -> int:
        """The domain to use. Raises BridgeError if $ROS_DOMAIN_ID is not a number."""
        return chosen_domain(self.domain_id)

    @property
    def is_local(self) -> bool:
        """Whether the bridge reaches only this machine."""
        return self.interface in ("", "lo") or _is_loopback(self.interface)

    def check(self) -> None:
        """Raises BridgeError for invalid values."""
        if not 0 <= self.domain <= MAX_DOMAIN:
            raise BridgeError(f"the DDS domain must be from 0 to {MAX_DOMAIN}, not {self.domain}")
        checked_interface(self.interface)
        for peer in self.peers:
            checked_peer(peer)
        far = far_of((*self.peers, *(parse_server(server)[0] for server in self.servers)))
        if far and self.is_local:
            raise BridgeError(
                f"{far[0]} can't be reached over the loopback interface: name the interface towards it, as "
                "in --interface eth0"
            )
        if self.distro not in ("auto", "humble"):
            raise BridgeError(f"the distro must be auto or humble, not '{self.distro}'")
        if self.servers and self.carrier_used == "cyclonedds":
            raise BridgeError(
                f"the Discovery Server {self.servers[0]} needs --carrier rtps: cyclonedds knows none"
            )


def checked_interface(text: str) -> str:
    """Check `text`, a name or an address, and return it. Raises BridgeError if it can't be one."""
    if not _is_plain(text):
        raise BridgeError(f"'{text}' is not the name or address of a network interface")
    return text


def checked_peer(text: str) -> str:
    """Check `text`, an address, and return it. Raises BridgeError if it can't be one."""
    if not _is_host(text):
        raise BridgeError(f"'{text}' is not the address of a machine")
    return text


def parse_server(text: str) -> tuple[str, int]:
    """The host and the port of a Discovery Server. Raises BridgeError if `text` names none."""
    host, colon, port = text.partition(":")
    if not _is_host(host) or (colon and not (port.isdecimal() and 0 < int(port) < 1 << 16)):
        raise BridgeError(
            f"'{text}' is not the address of a Discovery Server over UDP and IPv4, as in "
            f"'10.0.0.2:{_SERVER_PORT}'"
        )
    return host, int(port) if colon else _SERVER_PORT


def far_of(peers: tuple[str, ...]) -> list[str]:
    """The peers that are not this machine."""
    return [peer for peer in peers if not _is_loopback(peer)]


def _is_plain(text: str) -> bool:
    return text.isascii() and not any(letter in text for letter in "<>&\"'\0 ")


def _is_host(text: str) -> bool:
    """Whether `text` can be an address, or a name: each part of it has up to 63 characters."""
    return _is_plain(text) and all(0 < len(part) < 64 for part in text.removesuffix(".").split("."))


def _is_loopback(address: str) -> bool:
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address == "localhost"
