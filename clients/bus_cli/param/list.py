"""`bus param list`: names of parameters."""

import re
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from typing import Any

from bus.base.printable import printable
from bus.errors import BusError
from bus.names import is_hidden_node
from bus_cli.completion import completed_by, nodes
from bus_cli.output import CommandError, complain, print_json, say
from bus_cli.param.remote import (
    TYPE_NAMES,
    Remote,
    add_hidden_nodes_option,
    find_node,
    nodes_with_parameters,
)
from bus_cli.query import graph_to_list
from bus_cli.stream import open_node, run_stream


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(parser.add_argument("node_name", nargs="?", help="Name of the ROS node"), nodes)
    add_hidden_nodes_option(parser)
    parser.add_argument(
        "--param-prefixes",
        metavar="PREFIX",
        nargs="+",
        default=[],
        help="Only list parameters with the provided prefixes",
    )
    parser.add_argument(
        "--param-type", action="store_true", help="Print parameter types with parameter names"
    )
    parser.add_argument(
        "--filter", metavar="REGEX", type=_pattern, help="Only list parameters matching the provided regex"
    )


def main(args: Namespace) -> int:
    if args.node_name is not None:
        return run_stream(_list(args, [find_node(args)]))
    found = nodes_with_parameters(graph_to_list(args))
    shown = [name for name in found if args.include_hidden_nodes or not is_hidden_node(name)]
    return run_stream(_list(args, shown)) if shown else 0


async def _list(args: Namespace, names: list[str]) -> int:
    async with open_node(args) as node:
        for name in names:
            remote = Remote(node, name)
            try:
                found = await _find(args, remote)
            except (CommandError, BusError) as error:
                if args.node_name is not None:
                    raise
                complain(f"Exception while calling service of node '{name}': {error}")
                continue
            if args.json:
                print_json({"node": name, "parameters": found})
                continue
            if args.node_name is None and found:
                say(f"{name}:")
            for one in found:
                kind = f" (type: {one['type']})" if args.param_type else ""
                say(f"  {printable(one['name'], keep='')}{kind}")
    return 0


async def _find(args: Namespace, remote: Remote) -> list[dict[str, Any]]:
    names = await remote.names(args.param_prefixes)
    if args.filter is not None:
        names = [name for name in names if args.filter.match(name)]
    if not args.param_type:
        return [{"name": name} for name in names]
    types = (await remote.call("GetParameterTypes", names=names)).types
    return [
        {"name": name, "type": TYPE_NAMES[number] if number < len(TYPE_NAMES) else "unknown"}
        for name, number in zip(names, types, strict=False)
    ]


def _pattern(text: str) -> re.Pattern[str]:
    """Compile a regular expression, for argparse."""
    try:
        return re.compile(text)
    except re.error as error:
        raise ArgumentTypeError(f"'{text}' is not a regular expression: {error}") from None
