"""How far a participant looks for others: the addresses at which it announces itself. Pure.

The ranges are those of ROS 2's `ROS_AUTOMATIC_DISCOVERY_RANGE`.
"""

import ipaddress
from typing import Final, Literal, NamedTuple

from bus_bridge.rtps.parameters import Address
from bus_bridge.rtps.sockets import GROUP, discovery_port, multicast_port

__all__ = ["DiscoveryRange", "Reach"]

DiscoveryRange = Literal["OFF", "LOCALHOST", "SUBNET", "SYSTEM_DEFAULT"]

_CALLED: Final = 32
"""Participants of a machine that are called without multicast."""


class Reach(NamedTuple):
    """The place of a participant, and the other participants that it calls."""

    host: str = "127.0.0.1"
    """The IPv4 address of its interface. On loopback there is no multicast, and nothing leaves this
    machine."""
    peers: tuple[str, ...] = ()
    """Addresses of further machines."""
    discovery: DiscoveryRange = "SUBNET"
    """`LOCALHOST`: no multicast, so only `peers` and this machine are called. `OFF`: it calls no
    other participant, and ignores calls. `SYSTEM_DEFAULT` is the same as `SUBNET`."""
    servers: tuple[Address, ...] = ()
    """Discovery Servers of Fast DDS. With any, only they are called, and they tell of all others."""

    @property
    def is_off(self) -> bool:
        return self.discovery == "OFF"

    @property
    def is_local(self) -> bool:
        """Whether its interface is loopback."""
        return ipaddress.ip_address(self.host).is_loopback

    @property
    def has_multicast(self) -> bool:
        in_range = self.discovery in ("SUBNET", "SYSTEM_DEFAULT")
        return in_range and not self.is_local and not self.servers

    def called(self, domain: int) -> tuple[Address, ...]:
        """The addresses at which the participant announces itself. Each is called at its ports for
        participants of the domain, except the multicast group."""
        if self.is_off:
            return ()
        if self.servers:
            return self.servers
        machines = dict.fromkeys(self.peers if self.has_multicast else (self.host, *self.peers))
        group = [(GROUP, multicast_port(domain))] if self.has_multicast else []
        ports = [discovery_port(domain, index) for index in range(_CALLED)]
        return (*group, *((machine, port) for machine in machines for port in ports))
