"""`bus lifecycle nodes`: names of lifecycle nodes."""

from argparse import ArgumentParser, Namespace

from bus_cli.lifecycle.remote import lifecycle_nodes
from bus_cli.output import show
from bus_cli.query import graph_to_list


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("-a", "--all", action="store_true", help="Display all nodes even hidden ones")
    parser.add_argument(
        "-c", "--count-nodes", action="store_true", help="Only display the number of nodes discovered"
    )


def main(args: Namespace) -> int:
    found = lifecycle_nodes(graph_to_list(args), are_hidden_too=args.all)
    if args.count_nodes:
        show(len(found), {"count": len(found)}, as_json=args.json)
        return 0
    for name in found:
        show(name, {"node": name}, as_json=args.json)
    return 0
