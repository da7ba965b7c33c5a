"""The settings of a bridge, from the command line and busd.toml: as values, with types and ranges.

Engines know the meaning of addresses and certificates, and check them when the bridge begins.
"""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from bus_bridge.core.rules import TopicRule

__all__ = ["BridgeTable", "Ros2Table", "TlsTable", "ZenohTable"]


class TlsTable(msgspec.Struct, frozen=True, kw_only=True):
    """`[bridge.zenoh.tls]`: files, in PEM format; paths are relative to the configuration's folder."""

    ca: str | None = None
    """The certificate of the authority that has signed those of both sides."""
    certificate: str | None = None
    """This side's own."""
    key: str | None = None
    """The private key of `certificate`."""


class BridgeTable(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of every bridge; empty or None if not set. In TOML one text is as good as an array."""

    id: str | None = None
    """The name of this bus on other buses; by default made of the machine's name."""
    namespace: str | None = None
    """Goes in front of every name on the far side, and off every name that comes from there."""
    allow: tuple[str, ...] = ()
    """Patterns of topics that may cross; empty: all except those that never cross by default."""
    deny: tuple[str, ...] = ()
    """Patterns of topics that may not, whatever `allow` says."""
    topics: tuple[TopicRule, ...] = ()


class ZenohTable(BridgeTable, frozen=True, kw_only=True):
    """`[bridge.zenoh]`, or the options of `bus bridge zenoh`."""

    listen: tuple[str, ...] = ()
    """Addresses at which other bridges are awaited: `tls/0.0.0.0:7447`."""
    connect: tuple[str, ...] = ()
    """Addresses of other bridges."""
    router: tuple[str, ...] = ()
    """Addresses of routers of zenoh, of which one is used; instead of `listen` and `connect`."""
    insecure: bool | None = None
    """Whether addresses that other machines reach may do without certificates."""
    tls: TlsTable = TlsTable()


class Ros2Table(BridgeTable, frozen=True, kw_only=True):
    """`[bridge.ros2]`, or the options of `bus bridge ros2`."""

    domain_id: Annotated[int, Meta(ge=0, le=232)] | None = None
    """The DDS domain; by default $ROS_DOMAIN_ID, else 0."""
    interface: str | None = None
    """Network interface, by name or address; by default loopback."""
    peers: tuple[str, ...] = ()
    """Addresses of machines where ROS 2 runs, for networks without multicast."""
    distro: Literal["auto", "humble"] | None = None
    """`humble`: the far side speaks Humble's form of the graph, or an older one's."""
