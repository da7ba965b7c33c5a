"""Shared code of the verbs of `bus param`: nodes by name, their parameter services, values.

Knows services and the graph, but not the output of the verbs.
"""

import asyncio
from argparse import ArgumentParser, Namespace
from array import array
from collections.abc import AsyncIterator, Collection, Iterable
from contextlib import asynccontextmanager
from math import inf
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any

from bus.names import is_hidden_node
from bus.parameters.messages import SERVICES, python_value, value_message
from bus.parameters.values import ParameterType
from bus.process.address import socket_path
from bus_cli.completion import completed_by, nodes
from bus_cli.output import CommandError, complain, print_json, say
from bus_cli.query import Query

if TYPE_CHECKING:
    from bus.graph import Graph
    from bus.node import Node

__all__ = [
    "LABELS",
    "TYPE_NAMES",
    "Remote",
    "add_hidden_nodes_option",
    "add_node_argument",
    "find_node",
    "listed",
    "nodes_with_parameters",
    "open_remote",
    "plain",
    "say_result",
    "set_parameters",
    "value_of",
]

TYPE_NAMES = (
    "not set",
    "boolean",
    "integer",
    "double",
    "string",
    "byte array",
    "boolean array",
    "integer array",
    "double array",
    "string array",
)
"""Names of the types as ros2 writes them. The index is the number in rcl_interfaces/msg/ParameterType."""

LABELS = (
    "Parameter not set.",
    "Boolean value is:",
    "Integer value is:",
    "Double value is:",
    "String value is:",
    "Byte values are:",
    "Boolean values are:",
    "Integer values are:",
    "Double values are:",
    "String values are:",
)

_NODE_S = 1
_LOOK_S = 0.05
_ANSWER_S = 10.0
_APPEAR_S = 2.0  # a new node may not have its services yet
_TYPECODES = {7: "q", 8: "d"}


def add_node_argument(parser: ArgumentParser) -> None:
    """Add the argument for the node's name, and the options for finding the node."""
    completed_by(parser.add_argument("node_name", help="Name of the ROS node"), nodes)
    add_hidden_nodes_option(parser)
    parser.add_argument(
        "--timeout",
        metavar="N",
        type=int,
        default=_NODE_S,
        help=f"Wait for N seconds until node becomes available (default {_NODE_S} sec; -1: no limit)",
    )


def add_hidden_nodes_option(parser: ArgumentParser) -> None:
    parser.add_argument("--include-hidden-nodes", action="store_true", help="Consider hidden nodes as well")


def find_node(args: Namespace, timeout_s: float = 0.0) -> str:
    """The full name of the node on the command line, as soon as it exists.

    A negative time means no limit. Raises CommandError if the node has not appeared until then, or if it is
    hidden and hidden nodes are not wanted.
    """
    name: str = args.node_name if args.node_name.startswith("/") else f"/{args.node_name}"
    with Query(socket_path(args.socket, args.domain)) as query:
        graph = _graph_with(query, name, inf if timeout_s < 0 else timeout_s)
    found = [node for node in graph.nodes if node.full_name == name]
    if not found:
        from bus_cli.suggestions import near_node

        raise CommandError(f"Node not found{near_node(name, graph)}")
    if is_hidden_node(found[0].name) and not args.include_hidden_nodes:
        raise CommandError("Node not found; --include-hidden-nodes finds hidden ones, too")
    return name


def _graph_with(query: Query, name: str, timeout_s: float) -> "Graph":
    """The first graph with the node `name`, or the one at the end of the time."""
    end_s = monotonic() + timeout_s
    while True:
        graph = query.graph()
        if any(node.full_name == name for node in graph.nodes) or monotonic() >= end_s:
            return graph
        sleep(_LOOK_S)


def nodes_with_parameters(graph: "Graph") -> list[str]:
    """Full names of the nodes with parameter services, sorted."""
    names = {node.full_name for node in graph.nodes}
    return sorted(name for name in names if graph.servers_of(f"{name}/list_parameters"))


class Remote:
    """The parameters of the node called `name`. Calls raise CommandError if it does not answer."""

    def __init__(self, node: "Node", name: str) -> None:
        self.name = name
        self._node = node

    async def call(self, service: str, **fields: Any) -> Any:
        """Call one of its services; `service` is the name of its type."""
        from bus.types.classes import service_class

        definition: Any = service_class(f"rcl_interfaces/srv/{service}")
        full_name = f"{self.name}/{SERVICES[service]}"
        await self._wait_until_served(full_name)
        client = await self._node.create_client(definition, full_name)
        try:
            async with asyncio.timeout(_ANSWER_S):
                await client.wait_for_service()
                return await client.call(definition.Request(**fields))
        except TimeoutError:
            raise CommandError(
                f"node '{self.name}' does not answer ('{full_name}', {_ANSWER_S:g} s)"
            ) from None

    async def _wait_until_served(self, service: str) -> None:
        if (await self._node.graph()).servers_of(service):
            return
        try:
            async with asyncio.timeout(_APPEAR_S):
                await self._node.wait_for_graph(lambda graph: bool(graph.servers_of(service)))
        except TimeoutError:
            raise CommandError(f"node '{self.name}' has no parameters (no service '{service}')") from None

    async def names(self, prefixes: Iterable[str] = ()) -> list[str]:
        """Names of its parameters, sorted."""
        response = await self.call("ListParameters", prefixes=list(prefixes), depth=0)
        return sorted(response.result.names)

    async def near(self, name: str) -> str:
        """A hint with a similar name if the node has no parameter `name`; "" if it has it."""
        from bus.base.suggest import did_you_mean

        names = await self.names()
        return "" if name in names else did_you_mean(name, names)

    async def values(self, names: list[str]) -> list[Any]:
        """The values as ParameterValues, in the order of `names`."""
        response = await self.call("GetParameters", names=names)
        # ROS's C++ nodes return no values at all if one parameter is not declared.
        values = list(response.values) or [_message("ParameterValue")() for _ in names]
        return self._as_many(names, values)

    async def set(self, values: dict[str, Any]) -> list[Any]:
        """Set each parameter separately; None deletes it. Returns SetParametersResults.

        An empty list gets the type of the declaration.
        """
        make = _message("Parameter")
        types = await self._list_types([name for name, value in values.items() if value == []])
        parameters = [
            make(name=name, value=value_of(value, types.get(name, ParameterType.BOOL_ARRAY)))
            for name, value in values.items()
        ]
        response = await self.call("SetParameters", parameters=parameters)
        return self._as_many(values, response.results)

    async def _list_types(self, names: list[str]) -> dict[str, ParameterType]:
        """The types of those of `names` that are declared as lists."""
        if not names:
            return {}
        response = await self.call("DescribeParameters", names=names)
        known = [type_ for type_ in ParameterType if type_.is_array]
        return {one.name: ParameterType(one.type) for one in response.descriptors if one.type in known}

    def _as_many(self, wanted: Collection[str], found: list[Any]) -> list[Any]:
        if len(found) != len(wanted):
            raise CommandError(f"node '{self.name}' gave {len(found)} answers for {len(wanted)} parameters")
        return found


@asynccontextmanager
async def open_remote(args: Namespace, name: str) -> AsyncIterator[Remote]:
    """Open a node of the tool to access the parameters of the node `name`."""
    from bus_cli.stream import open_node

    async with open_node(args) as node:
        yield Remote(node, name)


def set_parameters(args: Namespace, name: str, values: dict[str, Any]) -> list[Any]:
    """Set parameters of one node, for a verb that does nothing else; returns SetParametersResults."""
    from bus_cli.stream import run_stream

    results: list[Any] = []

    async def call() -> int:
        async with open_remote(args, name) as remote:
            results.extend(await remote.set(values))
            for parameter, result in zip(values, results, strict=True):
                if not result.successful:
                    result.reason += await remote.near(parameter)
        return 0

    run_stream(call())
    return results


def plain(value: Any) -> Any:
    """The value in a ParameterValue; None if it is not set. A list of numbers is an `array`, as in rclpy."""
    try:
        found = python_value(value)
    except ValueError:  # a type that does not exist
        return None
    if isinstance(found, bytes):
        return [bytes((octet,)) for octet in found]
    return array(_TYPECODES[value.type], found) if value.type in _TYPECODES else found


def listed(value: Any) -> Any:
    """Convert a result of `plain` for JSON and YAML: arrays to lists, bytes to numbers."""
    if not isinstance(value, list | array):
        return value
    return [item[0] if isinstance(item, bytes) else item for item in value]


def say_result(args: Namespace, result: Any, done: str, failed: str) -> int:
    """Print a SetParametersResult; returns the exit code."""
    if args.json:
        print_json({"successful": result.successful, "reason": result.reason})
    else:
        text = done if result.successful else failed
        text += f": {result.reason}" if result.reason else ""
        (say if result.successful else complain)(text)
    return 0 if result.successful else 1


def value_of(value: Any, empty: ParameterType = ParameterType.BOOL_ARRAY) -> Any:
    """A ParameterValue for a value read by `bus.parameters.file`; None means not set.

    `empty`: the type of an empty list. Without a declaration, ROS takes it for a list of booleans.
    """
    if value == []:
        return value_message(_message, empty, b"" if empty is ParameterType.BYTE_ARRAY else value)
    return value_message(_message, ParameterType.from_parameter_value(value), value)


def _message(name: str) -> Any:
    from bus.types.classes import message_class

    return message_class(f"rcl_interfaces/msg/{name}")
