"""The settings of a bridge from the command line and busd.toml: values with types and ranges.

Engines interpret addresses and certificates, and check them at the start of the bridge.
"""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from bus_bridge.core.rules import TopicRule

__all__ = ["BridgeTable", "Ros2Table", "TlsTable", "ZenohTable"]


class TlsTable(msgspec.Struct, frozen=True, kw_only=True):
    """`[bridge.zenoh.tls]`: PEM files; paths are relative to the configuration's folder."""

    ca: str | None = None
    """The certificate of the authority that has signed both sides' certificates."""
    certificate: str | None = None
    """This side's own certificate."""
    key: str | None = None
    """The private key of `certificate`."""


class BridgeTable(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of every bridge; empty or None if not set. In TOML, a single text can replace an array."""

    id: str | None = None
    """The name of this bus on other buses; by default made from the machine's name."""
    namespace: str | None = None
    """A prefix for every name on the far side; removed from every incoming name."""
    allow: tuple[str, ...] = ()
    """Patterns of topics that may cross; empty: all topics except the private ones."""
    deny: tuple[str, ...] = ()
    """Patterns of topics that may not cross, even if `allow` has them."""
    topics: tuple[TopicRule, ...] = ()


class ZenohTable(BridgeTable, frozen=True, kw_only=True):
    """`[bridge.zenoh]`, or the options of `bus bridge zenoh`."""

    listen: tuple[str, ...] = ()
    """Addresses to listen on for other bridges: `tls/0.0.0.0:7447`."""
    connect: tuple[str, ...] = ()
    """Addresses of other bridges."""
    router: tuple[str, ...] = ()
    """Addresses of zenoh routers; one of them is used, instead of `listen` and `connect`."""
    insecure: bool | None = None
    """Whether addresses reachable from other machines may work without certificates."""
    compression: bool | None = None
    """Whether links compress, if the other side has this set, too."""
    group: str | None = None
    """The group of this bus in a fleet."""
    see: tuple[str, ...] = ()
    """The groups whose buses this one sees; empty: all buses."""
    tls: TlsTable = TlsTable()


class Ros2Table(BridgeTable, frozen=True, kw_only=True):
    """`[bridge.ros2]`, or the options of `bus bridge ros2`."""

    domain_id: Annotated[int, Meta(ge=0, le=232)] | None = None
    """The DDS domain; by default $ROS_DOMAIN_ID, else 0."""
    interface: str | None = None
    """Network interface, by name or address; by default loopback."""
    peers: tuple[str, ...] = ()
    """Addresses of machines with ROS 2, for networks without multicast."""
    discovery_servers: tuple[str, ...] = ()
    """Discovery Servers of Fast DDS, which tell of all nodes; added to the ones in $ROS_DISCOVERY_SERVER."""
    distro: Literal["auto", "humble"] | None = None
    """`humble`: the far side uses Humble's form of the graph."""
    carrier: Literal["auto", "cyclonedds", "rtps"] | None = None
    """The carrier of topics."""
    rmw: Literal["dds", "zenoh"] | None = None
    """The middleware of ROS 2's nodes."""
    connect: tuple[str, ...] = ()
    """With zenoh: addresses of routers or nodes of ROS 2; by default the router of this machine."""
    router: tuple[str, ...] = ()
    """With zenoh: routers that pass on all messages; one of them is used, instead of `connect`."""
    listen: tuple[str, ...] = ()
    """With zenoh: addresses to listen on; by default loopback, any port."""
    insecure: bool | None = None
    """With zenoh: as for `[bridge.zenoh]`."""
    tls: TlsTable = TlsTable()
