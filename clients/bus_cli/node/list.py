"""`bus node list`: names of nodes."""

from argparse import ArgumentParser, Namespace

from bus.names import is_hidden_node
from bus_cli.origin import origin_record, origin_text, origins
from bus_cli.output import complain, show
from bus_cli.query import graph_to_list

_NOT_UNIQUE = (
    "WARNING: Be aware that there are nodes in the graph that share an exact name, "
    "which can have unintended side effects."
)


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("-a", "--all", action="store_true", help="Display all nodes even hidden ones")
    parser.add_argument(
        "-c", "--count-nodes", action="store_true", help="Only display the number of nodes discovered"
    )


def main(args: Namespace) -> int:
    graph = graph_to_list(args)
    found = sorted(
        (node for node in graph.nodes if args.all or not is_hidden_node(node.name)),
        key=lambda node: (node.full_name, node.pid),
    )
    if args.count_nodes:
        show(len(found), {"count": len(found)}, as_json=args.json)
        return 0
    if len({node.full_name for node in found}) < len(found):
        complain(_NOT_UNIQUE)
    shown = origins(graph)
    for node in found:
        name, origin = node.full_name, shown.get(node.id)
        text = name if origin is None else f"{name} ({origin_text(origin)})"
        show(text, {"node": name, "pid": node.pid, **origin_record(node)}, as_json=args.json)
    return 0
