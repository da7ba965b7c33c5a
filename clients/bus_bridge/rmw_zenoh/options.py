"""The user's options for ROS 2 on zenoh."""

import msgspec

from bus_bridge.errors import BridgeError
from bus_bridge.ros2.domain import MAX_DOMAIN, chosen_domain
from bus_bridge.zenoh.options import ZenohOptions
from bus_bridge.zenoh.options import check as check_links

__all__ = ["RmwZenohOptions", "addresses_to_connect", "check"]

_ROUTER = "tcp/localhost:7447"
"""The address of the router that programs of ROS 2 use if nothing else is set."""


class RmwZenohOptions(msgspec.Struct, frozen=True):
    """Location of ROS 2. `check` checks the values."""

    links: ZenohOptions
    """Addresses and certificates. Without an address to listen at, the session listens on loopback at any
    port, as programs of ROS 2 do."""
    domain_id: int | None = None
    """None: $ROS_DOMAIN_ID, or 0."""

    @property
    def domain(self) -> int:
        """The domain to use. Raises BridgeError if $ROS_DOMAIN_ID is not a number."""
        return chosen_domain(self.domain_id)


def addresses_to_connect(
    connect: tuple[str, ...], listen: tuple[str, ...], router: tuple[str, ...]
) -> tuple[str, ...]:
    """The addresses to connect to with these settings; without any, the router of this machine."""
    return connect or (() if listen or router else (_ROUTER,))


def check(options: RmwZenohOptions) -> list[str]:
    """Check the options. Raises BridgeError for impossible or forbidden ones; returns warnings for the
    user."""
    if not 0 <= options.domain <= MAX_DOMAIN:
        raise BridgeError(f"the domain must be from 0 to {MAX_DOMAIN}, not {options.domain}")
    return check_links(options.links)
