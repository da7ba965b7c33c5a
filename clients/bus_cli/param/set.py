"""`bus param set`: set a parameter of a node."""

from argparse import ArgumentParser, Namespace

from bus.parameters.file import parse_typed
from bus_cli.param.remote import add_node_argument, find_node, say_result, set_parameters


def add_arguments(parser: ArgumentParser) -> None:
    add_node_argument(parser)
    parser.add_argument("parameter_name", help="Name of the parameter")
    parser.add_argument("value", help="Value of the parameter, in YAML")


def main(args: Namespace) -> int:
    name = find_node(args, args.timeout)
    result = set_parameters(args, name, {args.parameter_name: parse_typed(args.value)})[0]
    return say_result(args, result, "Set parameter successful", "Setting parameter failed")
