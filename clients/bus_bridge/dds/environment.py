"""ROS 2's variables of the environment for discovery, and their effect on a bridge. Pure.

The interface of a bridge is chosen by its options only: without one it reaches this machine only, whatever
the environment says. Within that reach the variables mean the same as for a node of ROS 2.
"""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple, get_args

import msgspec

from bus_bridge.dds.options import DdsOptions, checked_peer, far_of, parse_server
from bus_bridge.errors import BridgeError
from bus_bridge.rtps.reach import DiscoveryRange

__all__ = ["RANGE", "SERVERS", "STATIC_PEERS", "Told", "apply", "read"]

RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
STATIC_PEERS: Final = "ROS_STATIC_PEERS"
SERVERS: Final = "ROS_DISCOVERY_SERVER"

_RANGES: Final[tuple[DiscoveryRange, ...]] = get_args(DiscoveryRange)


class Told(NamedTuple):
    """The values of the variables."""

    discovery: DiscoveryRange | None = None
    """None: the variable is not set, or empty."""
    peers: tuple[str, ...] = ()
    servers: tuple[str, ...] = ()


def read(environment: Mapping[str, str]) -> Told:
    """Read the variables. Raises BridgeError for a wrong value."""
    return Told(
        _range(environment.get(RANGE, "")),
        _addresses(STATIC_PEERS, environment.get(STATIC_PEERS, ""), checked_peer, "10.0.0.2;robot.local"),
        _addresses(SERVERS, environment.get(SERVERS, ""), parse_server, "10.0.0.2:11811;10.0.0.3:11811"),
    )


def apply(options: DdsOptions, told: Told) -> tuple[DdsOptions, list[str]]:
    """The options with what the environment adds, and lines for the user about its effect.

    Raises BridgeError for a Discovery Server out of reach.
    """
    discovery = told.discovery or "SUBNET"
    servers = tuple(dict.fromkeys((*options.servers, *told.servers)))
    made = msgspec.structs.replace(options, discovery=discovery, servers=servers)
    if discovery == "OFF":
        lines = [f"{RANGE} is OFF: the bridge finds no node of ROS 2, and none finds the bridge"]
        given = ((STATIC_PEERS, told.peers), ("a Discovery Server", servers))
        lines += [f"{RANGE} is OFF: {name} has no effect" for name, has_any in given if has_any]
        return msgspec.structs.replace(made, servers=()), lines
    if servers:
        if options.is_local and (far := far_of(tuple(parse_server(one)[0] for one in told.servers))):
            raise BridgeError(f"{SERVERS} has {far[0]}, which the bridge can't reach without --interface")
        given = (("--peer", made.peers), (STATIC_PEERS, told.peers))
        lines = [f"nodes are found by Discovery Servers: {', '.join(servers)}"]
        lines += [f"with a Discovery Server, {name} has no effect" for name, has_any in given if has_any]
        return msgspec.structs.replace(made, peers=()), lines
    lines = []
    match told.discovery:
        case "LOCALHOST" if not options.is_local:
            lines.append(f"{RANGE} is LOCALHOST: no multicast, so other machines are found as peers only")
        case "SUBNET" if options.is_local:
            lines.append(f"{RANGE} is SUBNET, but without --interface the bridge reaches this machine only")
    peers = told.peers
    if peers and discovery == "SYSTEM_DEFAULT":
        lines.append(f"{RANGE} is {discovery}: {STATIC_PEERS} has no effect")
        peers = ()
    if options.is_local and (far := far_of(peers)):
        lines.append(f"{STATIC_PEERS} has {far[0]}, which the bridge can't reach without --interface")
        peers = tuple(peer for peer in peers if peer not in far)
    return msgspec.structs.replace(made, peers=tuple(dict.fromkeys((*made.peers, *peers)))), lines


def _range(text: str) -> DiscoveryRange | None:
    if not text:
        return None
    for one in _RANGES:
        if one == text:
            return one
    raise BridgeError(f"{RANGE} must be one of {', '.join(_RANGES)}, not '{text}'")


def _addresses(name: str, text: str, checked: Callable[[str], object], example: str) -> tuple[str, ...]:
    """The addresses in that variable. Empty ones are skipped: in ROS_DISCOVERY_SERVER they keep the ids of
    later servers."""
    found = tuple(part for part in text.split(";") if part)
    for part in found:
        try:
            checked(part)
        except BridgeError as error:
            raise BridgeError(
                f"{name}: {error}; addresses are separated by semicolons, as in '{example}'"
            ) from None
    return found
