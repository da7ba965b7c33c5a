"""Bridges to other machines and to ROS 2: packages, tables of busd.toml, ports, a router, receive buffers."""

import errno
import os
import socket
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path

from bus.errors import BusError
from bus.graph import Graph
from bus_bridge.config import TABLES, load
from bus_bridge.core.status import SERVICE_TYPE
from bus_bridge.extras import EXTRAS, why_missing, why_no_rmw_zenoh
from bus_bridge.options import Ros2Table, ZenohTable
from bus_bridge.rmw_zenoh.options import addresses_to_connect
from bus_bridge.zenoh.options import Address, parse_address
from bus_cli.doctor import procfs
from bus_cli.doctor.finding import Finding, fail, ok, warn
from bus_cli.main import version

__all__ = ["engines_with_bridges", "examine"]

_RMW_ZENOH = "rmw_zenoh"
_CONNECT_S = 1.0
_BUFFERS = Path("/proc/sys/net/core")
_WANTED_BYTES = 4 << 20
"""With the kernel's 208 KiB, most images of 900 KB were lost on the way to ROS 2, with this size none."""


def engines_with_bridges(graph: Graph) -> set[str]:
    """Engines with a running bridge on this bus."""
    found = (name for name, types in graph.services().items() if SERVICE_TYPE in types)
    return {engine for name in found for engine in (*TABLES, _RMW_ZENOH) if f"/bridge_{engine}" in name}


def examine(
    file: Path | None, running: Collection[str] = (), environment: Mapping[str, str] = os.environ
) -> Iterator[Finding]:
    """Findings about bridges. `file`: busd's configuration; `running`: engines with a bridge on this bus."""
    for engine, kind in TABLES.items():
        try:
            table = load(file, kind) if file is not None else kind()
        except BusError as error:
            yield fail("bridges", str(error), "correct it: no such bridge starts with it")
            continue
        if isinstance(table, Ros2Table) and table.rmw == "zenoh":
            yield from _rmw_zenoh(table, is_running=_RMW_ZENOH in running)
            continue
        is_wanted = table != kind()
        if why := why_missing(engine):
            text, _, advice = why.partition(": ")
            yield (warn("bridges", text, advice) if is_wanted else ok("bridges", why))
            if not EXTRAS[engine].is_optional:
                continue
        else:
            extra = EXTRAS[engine]
            yield ok("bridges", f"{extra.distribution} {version(extra.distribution)}")
        if isinstance(table, ZenohTable):
            yield from _ports(table.listen, is_running=engine in running)
        if engine == "ros2":
            if environment.get("RMW_IMPLEMENTATION") == "rmw_zenoh_cpp" and _RMW_ZENOH not in running:
                text = "ROS 2's nodes use zenoh here (RMW_IMPLEMENTATION)"
                yield warn(
                    "bridges", f"{text}: a bridge by DDS does not find them", "bus bridge ros2 --rmw zenoh"
                )
            yield _receive_buffers()


def _rmw_zenoh(table: Ros2Table, *, is_running: bool) -> Iterator[Finding]:
    """Findings about a bridge to ROS 2 on zenoh, which needs a router, as ROS 2's own nodes do."""
    if why := why_no_rmw_zenoh():
        text, _, advice = why.partition(": ")
        yield warn("bridges", text, advice)
        return
    yield ok("bridges", f"eclipse-zenoh {version('eclipse-zenoh')}, xxhash {version('xxhash')}")
    yield from _ports(table.listen, is_running=is_running)
    for text in addresses_to_connect(table.connect, table.listen, table.router):
        address = parse_address(text)  # `load` has checked it
        if address.protocol == "tcp" and address.host == "localhost":
            yield _router(text, address)


def _router(text: str, address: Address) -> Finding:
    try:
        socket.create_connection((address.host, address.port), _CONNECT_S).close()
    except OSError:
        missing = f"no router at {text}: nodes of ROS 2 on zenoh find each other by it"
        return warn("bridges", missing, "ros2 run rmw_zenoh_cpp rmw_zenohd")
    return ok("bridges", f"a router answers at {text}")


def _ports(listen: Iterable[str], *, is_running: bool) -> Iterator[Finding]:
    """Whether a bridge could listen on these addresses."""
    for text in listen:
        try:
            fault = _find_fault(parse_address(text))
        except BusError as error:
            yield fail("bridges", str(error), "correct listen in busd.toml")
            continue
        if fault is None:
            yield ok("bridges", f"{text} is free")
        elif fault.errno != errno.EADDRINUSE:
            yield warn("bridges", f"{text}: {fault.strerror}", "choose an address of this machine")
        elif is_running:
            yield ok("bridges", f"{text} is in use, and a bridge runs")
        else:
            yield warn(
                "bridges", f"{text} is in use by another program", "stop that program, or choose another port"
            )


def _find_fault(address: Address) -> OSError | None:
    """The error of binding a socket there. A host name gives None: to resolve it may take long."""
    kind = socket.SOCK_DGRAM if address.protocol == "quic" else socket.SOCK_STREAM
    host = "127.0.0.1" if address.host == "localhost" else address.host
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(
            host, address.port, type=kind, flags=socket.AI_NUMERICHOST
        )[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(place)
    except (socket.gaierror, UnicodeError):  # UnicodeError: a part of the name is too long
        return None
    except OSError as error:
        return error
    return None


def _receive_buffers() -> Finding:
    """The kernel's receive buffers. DDS needs large ones: a large message comes in many packets at once."""
    sizes = {name: procfs.number_in(str(_BUFFERS / name)) for name in ("rmem_default", "rmem_max")}
    found = {name: size for name, size in sizes.items() if size is not None}
    text = ", ".join(f"net.core.{name} = {size}" for name, size in found.items()) or "not visible here"
    if any(size < _WANTED_BYTES for size in found.values()):
        advice = "sysctl -w " + " ".join(f"net.core.{name}={_WANTED_BYTES}" for name in found)
        return warn("receive buffers", f"{text}: nodes of ROS 2 here may lose large images", advice)
    return ok("receive buffers", text)
