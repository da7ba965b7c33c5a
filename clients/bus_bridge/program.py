"""Runs a bridge until it is stopped: `bus bridge zenoh`, `bus bridge ros2`."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bus.graph import Origin
from bus.node import Node
from bus_bridge.core.bridge import Bridge, BridgeOptions
from bus_bridge.core.bus_id import find_bus_id
from bus_bridge.engine import Engine
from bus_bridge.errors import BridgeError
from bus_bridge.extras import why_no_rmw_zenoh
from bus_bridge.labels import checked_id
from bus_bridge.options import BridgeTable, Ros2Table, ZenohTable
from bus_bridge.reloading import Reloading, Source, rules_of
from bus_bridge.ros2.domain import chosen_domain

if TYPE_CHECKING:
    from bus_bridge.zenoh.options import ZenohOptions

__all__ = ["Plan", "node_name"]

_MakeEngine = Callable[[str], Engine]
"""Makes the engine for the bus with this id."""
_NOTHING: Final = Ros2Table()


class Plan:
    """A bridge with the user's settings. `engine` is the users' name of it, `table` has its settings.

    Raises BridgeError and ConfigurationError for impossible or forbidden settings. Nothing is opened or
    started yet.
    """

    def __init__(self, engine: str, table: BridgeTable) -> None:
        self._name = engine
        self._node = node_name(engine, table)
        self._table = table
        self._rules, self._naming = rules_of(engine, table)
        self._id = checked_id(table.id) if table.id is not None else None
        self._make_engine, self._places = _plan_engine(table)

    async def run(self, path: Path, log_level: str = "info", source: Source | None = None) -> None:
        """Connect the bus of the running busd at `path` to the far side until cancelled.

        At SIGHUP, the rules of `source` apply.

        Raises BridgeError if the engine can't start. Cancellation is the normal end: then neither side sees
        nodes of the other any more.
        """
        bus = self._id or _default_id(path)
        origin = Origin(bridge=self._name, bus=bus)
        arguments = ["--ros-args", "--log-level", log_level]
        async with Node(self._node, arguments=arguments, socket=path, origin=origin) as node:
            options = BridgeOptions(
                bus=bus,
                rules=self._rules,
                naming=self._naming,
                socket=path,
                journal=path.with_name(f"{path.name}.{self._node}"),
            )
            bridge = Bridge(node, self._make_engine(bus), options)
            log = node.get_logger()
            log.info(f"this bus is '{bus}'")
            reloading = Reloading(self._name, self._table, source, bridge.reconfigure, log)
            with reloading.at_hangup():
                await bridge.run(lambda: [log.info(place) for place in self._places])


def node_name(engine: str, table: BridgeTable) -> str:
    """The name of a bridge's node. Raises BridgeError if $ROS_DOMAIN_ID is not a number.

    A bus may have bridges to several domains and middlewares of ROS 2, and `bus bridge status` asks each by
    its name.
    """
    if not isinstance(table, Ros2Table):
        return f"bridge_{engine}"
    domain = chosen_domain(table.domain_id)
    return ("bridge_rmw_zenoh" if table.rmw == "zenoh" else f"bridge_{engine}") + (
        f"_{domain}" if domain else ""
    )


def _default_id(path: Path) -> str:
    try:
        return find_bus_id(str(path))
    except OSError as error:
        raise BridgeError(f"no id can be made for the bus at {path} ({error.strerror}): give --id") from None


def _plan_engine(table: BridgeTable) -> tuple[_MakeEngine, list[str]]:
    """The function that makes the engine, and the lines to log after its start."""
    if isinstance(table, ZenohTable):
        return _plan_zenoh(table)
    assert isinstance(table, Ros2Table)
    return _plan_ros2(table)


def _plan_zenoh(table: ZenohTable) -> tuple[_MakeEngine, list[str]]:
    from msgspec import structs

    from bus_bridge.zenoh.engine import ZenohEngine
    from bus_bridge.zenoh.groups import Groups
    from bus_bridge.zenoh.options import check

    links = _links(table.listen, table.connect, table, table.router)
    groups = Groups(table.group or "", tuple(dict.fromkeys(table.see)))
    options = structs.replace(links, compression=bool(table.compression), groups=groups)
    check(options)
    places = [f"listening on {place}" for place in table.listen]
    places += [f"connecting to {place}" for place in table.connect]
    places += [f"connecting to the router at {place}" for place in table.router]
    places += [str(groups)] if groups != Groups() else []
    return lambda bus: ZenohEngine(bus, options, owns_process=True), places


def _links(
    listen: tuple[str, ...],
    connect: tuple[str, ...],
    table: ZenohTable | Ros2Table,
    router: tuple[str, ...] = (),
) -> "ZenohOptions":
    from bus_bridge.zenoh.options import ZenohOptions

    return ZenohOptions(
        listen=listen,
        connect=connect,
        router=router,
        ca=table.tls.ca or "",
        certificate=table.tls.certificate or "",
        key=table.tls.key or "",
        insecure=bool(table.insecure),
    )


def _plan_ros2(table: Ros2Table) -> tuple[_MakeEngine, list[str]]:
    only_dds = ("interface", "peers", "discovery_servers", "distro", "carrier")
    only_zenoh = ("connect", "router", "listen", "insecure", "tls")
    is_zenoh = table.rmw == "zenoh"
    for key in only_dds if is_zenoh else only_zenoh:
        if getattr(table, key) != getattr(_NOTHING, key):
            other = "dds" if is_zenoh else "zenoh"
            raise BridgeError(f"'{key}' is an option of ROS 2 on {other}: --rmw {other}")
    return _plan_rmw_zenoh(table) if is_zenoh else _plan_dds(table)


def _plan_rmw_zenoh(table: Ros2Table) -> tuple[_MakeEngine, list[str]]:
    if why := why_no_rmw_zenoh():
        raise BridgeError(why)
    from bus_bridge.rmw_zenoh.engine import RmwZenohEngine
    from bus_bridge.rmw_zenoh.options import RmwZenohOptions, addresses_to_connect, check

    connect = addresses_to_connect(table.connect, table.listen, table.router)
    options = RmwZenohOptions(_links(table.listen, connect, table, table.router), table.domain_id)
    check(options)
    places = [f"in ROS 2's domain {options.domain} on zenoh"]
    places += [f"listening on {place}" for place in table.listen]
    places += [f"connecting to {place}" for place in connect]
    places += [f"connecting to the router at {place}" for place in table.router]
    return lambda bus: RmwZenohEngine(bus, options), places


def _plan_dds(table: Ros2Table) -> tuple[_MakeEngine, list[str]]:
    from bus_bridge.dds import environment
    from bus_bridge.dds.engine import DdsEngine
    from bus_bridge.dds.options import DdsOptions

    options = DdsOptions(
        domain_id=table.domain_id,
        interface=table.interface or "",
        peers=table.peers,
        distro=table.distro or "auto",
        carrier=table.carrier or "auto",
        servers=table.discovery_servers,
    )
    options.check()
    options, remarks = environment.apply(options, environment.read(os.environ))
    options.check()
    where = "this machine only" if options.is_local else f"interface {options.interface}"
    places = [f"in ROS 2's domain {options.domain} on DDS, {where}", *remarks]
    if options.carrier == "auto" and options.carrier_used == "rtps" and not options.servers:
        places.append("cyclonedds is not installed: topics go by the RTPS of busd, which is slower")
    return lambda bus: DdsEngine(bus, options), places
