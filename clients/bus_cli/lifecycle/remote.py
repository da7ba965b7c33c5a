"""Shared code of the lifecycle verbs: lifecycle nodes by name, calls of their services, completion."""

import asyncio
from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING, Any

from bus.errors import BusError
from bus.names import is_hidden_node
from bus_cli.completion import completed_by
from bus_cli.output import CommandError
from bus_cli.query import get_graph

if TYPE_CHECKING:
    from bus.graph import Graph
    from bus.node import Node

__all__ = ["add_node_argument", "call", "find_node", "lifecycle_nodes", "transitions"]

ANSWER_S = 10.0
_LABELS = ("configure", "cleanup", "activate", "deactivate", "shutdown")


def add_node_argument(parser: ArgumentParser, *, is_optional: bool = False) -> None:
    """Add the argument for the node's name, and the option for hidden nodes."""
    more = ". If no name is provided, then get the state for all nodes" if is_optional else ""
    action = parser.add_argument(
        "node_name", nargs="?" if is_optional else None, help=f"Name of the ROS node{more}"
    )
    completed_by(action, _complete_nodes)
    parser.add_argument("--include-hidden-nodes", action="store_true", help="Consider hidden nodes as well")


def lifecycle_nodes(graph: "Graph", *, are_hidden_too: bool) -> list[str]:
    """Full names of the lifecycle nodes, sorted: nodes with a service for their state."""
    services = graph.services()
    found = {
        node.full_name
        for node in graph.nodes
        if (are_hidden_too or not is_hidden_node(node.name))
        and "lifecycle_msgs/srv/GetState" in services.get(f"{node.full_name}/get_state", ())
    }
    return sorted(found)


def find_node(args: Namespace) -> str:
    """The full name of the lifecycle node on the command line. Raises CommandError if it is not one."""
    name: str = args.node_name if args.node_name.startswith("/") else f"/{args.node_name}"
    graph = get_graph(args)
    seen = lifecycle_nodes(graph, are_hidden_too=args.include_hidden_nodes)
    if name in seen:
        return name
    if name in lifecycle_nodes(graph, are_hidden_too=True):
        raise CommandError("Node not found; --include-hidden-nodes finds hidden ones, too")
    if any(node.full_name == name for node in graph.nodes):
        raise CommandError(f"Node not found: '{name}' exists, but is not a lifecycle node")
    from bus.base.suggest import did_you_mean

    raise CommandError(f"Node not found{did_you_mean(name, seen)}")


async def call(
    node: "Node", name: str, service: str, srv_type: str, *, timeout_s: float | None = ANSWER_S, **fields: Any
) -> Any:
    """Call one service of the lifecycle node `name`. Use `timeout_s` None for a transition, which may take
    long. Raises CommandError if no answer comes.
    """
    from bus.types.classes import service_class

    definition: Any = service_class(f"lifecycle_msgs/srv/{srv_type}")
    try:
        client = await node.create_client(definition, f"{name}/{service}")
        async with asyncio.timeout(ANSWER_S):
            await client.wait_for_service()
        async with asyncio.timeout(timeout_s):
            return await client.call(definition.Request(**fields))
    except TimeoutError:
        why = f"it does not answer ('{name}/{service}', {ANSWER_S:g} s)"
    except BusError as error:
        why = str(error)
    raise CommandError(f"Exception while calling service of node '{name}': {why}")


def transitions(prefix: str, parsed_args: Namespace, **_: Any) -> tuple[str, ...]:
    """Labels of transitions, for completion."""
    return _LABELS


def _complete_nodes(prefix: str, parsed_args: Namespace, **_: Any) -> list[str]:
    try:
        graph = get_graph(parsed_args, may_start=False)
    except (BusError, OSError):
        return []
    return lifecycle_nodes(graph, are_hidden_too=parsed_args.include_hidden_nodes)
