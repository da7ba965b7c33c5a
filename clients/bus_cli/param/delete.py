"""`bus param delete`: delete a parameter of a node."""

from argparse import ArgumentParser, Namespace

from bus_cli.param.remote import add_node_argument, find_node, say_result, set_parameters


def add_arguments(parser: ArgumentParser) -> None:
    add_node_argument(parser)
    parser.add_argument("parameter_name", help="Name of the parameter")


def main(args: Namespace) -> int:
    result = set_parameters(args, find_node(args, args.timeout), {args.parameter_name: None})[0]
    return say_result(args, result, "Deleted parameter successfully", "Deleting parameter failed")
