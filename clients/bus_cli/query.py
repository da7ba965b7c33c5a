"""The blocking client of the broker, for verbs with one question; names on the command line; `find` verbs."""

import os
import sys
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bus import names
from bus.graph import Graph
from bus.link import query as library
from bus.link.query import NotRunning
from bus.process.address import socket_path
from bus_cli.output import CommandError, complain, show

if TYPE_CHECKING:
    from bus.types.definitions import Kind

__all__ = [
    "NotRunning",
    "Query",
    "full_topic_name",
    "full_type_name",
    "get_graph",
    "graph_to_list",
    "show_found",
]


class Query(library.Query):
    """As the library's; a line on stderr says if busd is slow to answer."""

    def __init__(self, path: Path, *, may_start: bool = True, answer_s: float = library.ANSWER_S) -> None:
        super().__init__(path, may_start=may_start, answer_s=answer_s, program="bus", on_slow=complain)


def get_graph(args: Namespace, *, statistics: bool = False, may_start: bool = True) -> Graph:
    """The graph of the broker on the command line."""
    with Query(socket_path(args.socket, args.domain), may_start=may_start) as query:
        return query.graph(statistics=statistics)


def graph_to_list(args: Namespace) -> Graph:
    """The graph for a verb that lists names. If it is empty, users at a terminal get a hint with the bus."""
    path = socket_path(args.socket, args.domain)
    with Query(path) as query:
        graph = query.graph()
    if sys.stderr.isatty() and all(names.is_hidden_node(node.name) for node in graph.nodes):
        complain(f"no nodes on {path}{_chosen_by(args)}")
    return graph


def _chosen_by(args: Namespace) -> str:
    """The variable that chose the bus, for users who have forgotten that it is set."""
    if args.socket is not None:
        return ""
    for name in ("BUSD_SOCKET", "BUSD_DOMAIN"):
        if (value := os.environ.get(name)) and (name == "BUSD_SOCKET" or args.domain is None):
            return f" (set by {name}={value})"
    return ""


def show_found(
    args: Namespace,
    what: str,
    kind: "Kind",
    wanted: str,
    found: Sequence[str],
    *,
    only_count: bool,
    graph: Graph | None = None,
) -> int:
    """Print the topics, services or actions (`what`) of the type `wanted`, or their number; returns 0.

    Without any, a line on stderr names a near type, of `graph` too.
    """
    if not found:
        from bus_cli.suggestions import near_type

        if near := near_type(wanted, kind, graph):
            complain(f"no {what} has the type '{wanted}'{near}")
    if only_count:
        show(len(found), {"count": len(found)}, as_json=args.json)
        return 0
    for name in found:
        show(name, {what: name, "type": wanted}, as_json=args.json)
    return 0


def full_topic_name(name: str) -> str:
    """The full name of a topic on the command line: a relative name is in the root namespace."""
    return names.expand_topic_name(name, "_bus_cli", "/")


def full_type_name(text: str, kind: "Kind" = "msg") -> str:
    """Expand a type name: `std_msgs/String` is `std_msgs/msg/String`. Raises CommandError for other words."""
    parts = text.split("/")
    if len(parts) not in (2, 3) or not all(parts):
        from bus_cli.suggestions import near_type

        what = {"msg": "message", "srv": "service", "action": "action"}[kind]
        raise CommandError(f"The passed {what} type is invalid{near_type(text, kind)}")
    return text if len(parts) == 3 else f"{parts[0]}/{kind}/{parts[1]}"
