"""`bus param load`: set the parameters of a node from a file."""

from argparse import ArgumentParser, Namespace

from bus.parameters.file import overrides, read_file
from bus_cli.output import CommandError, complain, print_json, say
from bus_cli.param.remote import add_node_argument, find_node, set_parameters


def add_arguments(parser: ArgumentParser) -> None:
    add_node_argument(parser)
    parser.add_argument("parameter_file", help="Parameter file, in YAML")
    parser.add_argument(
        "--no-use-wildcard",
        action="store_true",
        help="Do not load parameters in the '/**' namespace into the node",
    )


def main(args: Namespace) -> int:
    name = find_node(args, args.timeout)
    sections = read_file(args.parameter_file)
    chosen = [
        section
        for section in sections
        if section.is_for(name) and not (args.no_use_wildcard and "*" in section.pattern)
    ]
    if not chosen:
        known = [section.pattern for section in sections]
        raise CommandError(f"Param file does not contain parameters for {name}, only for nodes: {known}")
    values = overrides(chosen, name)
    results = dict(zip(values, set_parameters(args, name, values), strict=True))
    for parameter, result in results.items():
        reason = f": {result.reason}" if result.reason else ""
        if args.json:
            print_json({"parameter": parameter, "successful": result.successful, "reason": result.reason})
        elif result.successful:
            say(f"Set parameter {parameter} successful{reason}")
        else:
            complain(f"Set parameter {parameter} failed{reason}")
    return 0 if all(result.successful for result in results.values()) else 1
