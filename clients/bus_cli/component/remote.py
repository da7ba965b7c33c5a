"""Shared code of the component verbs: containers in the graph, calls of their services, arguments."""

import asyncio
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from bus.errors import BusError
from bus_cli.completion import completed_by, live_graph, packages
from bus_cli.output import CommandError
from bus_cli.query import get_graph

if TYPE_CHECKING:
    from bus.graph import Graph
    from bus.node import Node

__all__ = [
    "ServiceMissing",
    "add_component_arguments",
    "add_container_argument",
    "call",
    "containers",
    "find_container",
    "load",
]

_SERVICES = {"load_node": "LoadNode", "unload_node": "UnloadNode", "list_nodes": "ListNodes"}
APPEAR_S = 5.0
"""Longest time until the services of a container appear."""
_LEVELS = {"DEBUG": 10, "INFO": 20, "WARN": 30, "ERROR": 40, "FATAL": 50}
_MOST_LEVEL = 255


class ServiceMissing(CommandError):
    """A container has no such service, or does not answer."""


def add_container_argument(parser: ArgumentParser, help_: str, *, is_optional: bool = False) -> None:
    completed_by(
        parser.add_argument("container_node_name", nargs="?" if is_optional else None, help=help_),
        _complete_containers,
    )


def add_component_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("package_name", help="Name of the package where the component is to be found"),
        packages,
    )
    completed_by(
        parser.add_argument(
            "plugin_name", help="Type name of the component to be loaded, or module:Class of a node in Python"
        ),
        _complete_types,
    )
    parser.add_argument("-n", "--node-name", default="", help="Component node name")
    parser.add_argument("--node-namespace", default="", help="Component node namespace")
    parser.add_argument("--log-level", type=_level, default=0, help="Component node log level")
    parser.add_argument(
        "-r",
        "--remap-rule",
        action="append",
        dest="remap_rules",
        default=[],
        metavar="from:=to",
        help="Component node remapping rules, in the 'from:=to' form",
    )
    for short, long, text in (
        ("-p", "--parameter", "Component node parameters, in the 'name:=value' form"),
        ("-e", "--extra-argument", "Extra arguments for the container, in the 'name:=value' form"),
    ):
        parser.add_argument(
            short,
            long,
            action="append",
            dest=f"{long[2:].replace('-', '_')}s",
            default=[],
            type=_pair,
            metavar="name:=value",
            help=text,
        )


def containers(graph: "Graph") -> list[str]:
    """Full names of the nodes with the services of a container, sorted."""
    services = graph.services()
    names = {node.full_name for node in graph.nodes}
    return sorted(
        name
        for name in names
        if all(
            f"composition_interfaces/srv/{kind}" in services.get(f"{name}/_container/{service}", ())
            for service, kind in _SERVICES.items()
        )
    )


def find_container(args: Namespace) -> str:
    """The full name of the container on the command line. Raises CommandError if it is not one."""
    name: str = args.container_node_name
    full = name if name.startswith("/") else f"/{name}"
    graph = get_graph(args)
    found = containers(graph)
    if full in found:
        return full
    from bus.base.suggest import did_you_mean

    if any(node.full_name == full for node in graph.nodes):
        raise CommandError(f"Unable to find container node '{name}': the node has no services of a container")
    raise CommandError(f"Unable to find container node '{name}'{did_you_mean(full, found)}")


async def call(
    node: "Node",
    container: str,
    service: str,
    *,
    timeout_s: float | None = None,
    appear_s: float = APPEAR_S,
    **fields: Any,
) -> Any:
    """Call a service of a container. Without `timeout_s` the answer may take any time, because a component
    may start slowly. Raises ServiceMissing if the service does not exist, or if no answer comes.
    """
    from bus.types.classes import service_class

    definition: Any = service_class(f"composition_interfaces/srv/{_SERVICES[service]}")
    client = await node.create_client(definition, f"{container}/_container/{service}")
    try:
        async with asyncio.timeout(appear_s):
            await client.wait_for_service()
    except TimeoutError:
        raise ServiceMissing(f"No '{service}' service found for '{container}' container") from None
    try:
        async with asyncio.timeout(timeout_s):
            return await client.call(definition.Request(**fields))
    except TimeoutError:
        raise ServiceMissing(f"No '{service}' service response") from None
    except BusError as error:
        raise ServiceMissing(str(error)) from None


async def load(
    node: "Node", container: str, args: Namespace, *, appear_s: float = APPEAR_S
) -> tuple[int, str]:
    """Load the component of the arguments; returns its id and its name. Raises CommandError."""
    response = await call(
        node,
        container,
        "load_node",
        appear_s=appear_s,
        package_name=args.package_name,
        plugin_name=args.plugin_name,
        node_name=args.node_name,
        node_namespace=args.node_namespace,
        log_level=args.log_level,
        remap_rules=args.remap_rules,
        parameters=list(_parameters(args.parameters)),
        extra_arguments=list(_parameters(args.extra_arguments)),
    )
    if not response.success:
        raise CommandError(f"Failed to load component: {response.error_message}")
    return response.unique_id, response.full_node_name


def _parameters(pairs: Iterable[tuple[str, str]]) -> Iterable[Any]:
    from bus.parameters.file import parse_typed
    from bus.types.classes import message_class
    from bus_cli.param.remote import value_of

    make: Any = message_class("rcl_interfaces/msg/Parameter")
    for name, text in pairs:
        yield make(name=name, value=value_of(parse_typed(text)))


def _pair(text: str) -> tuple[str, str]:
    """For argparse."""
    name, is_pair, value = text.partition(":=")
    if not (name and is_pair):
        raise ArgumentTypeError(f"'{text}' is not name:=value")
    return name, value


def _level(text: str) -> int:
    """A level by name or number, for argparse."""
    found = _LEVELS.get(text.upper(), int(text) if text.isascii() and text.isdigit() else _MOST_LEVEL + 1)
    if found > _MOST_LEVEL:
        raise ArgumentTypeError(f"'{text}' is not one of {', '.join(_LEVELS).lower()}")
    return found


def _complete_containers(prefix: str, parsed_args: Namespace, **_: Any) -> list[str]:
    graph = live_graph(parsed_args)
    return containers(graph) if graph else []


def _complete_types(prefix: str, parsed_args: Namespace, **_: Any) -> list[str]:
    from bus_ros.rclpy_components.registry import component_types

    wanted = getattr(parsed_args, "package_name", None)
    return [one.name for one in component_types() if wanted in (None, one.package)]
