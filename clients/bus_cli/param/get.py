"""`bus param get`: the value of a parameter."""

from argparse import ArgumentParser, Namespace

from bus_cli.output import CommandError, complain, print_json, say
from bus_cli.param.remote import (
    LABELS,
    TYPE_NAMES,
    add_node_argument,
    find_node,
    listed,
    open_remote,
    plain,
)
from bus_cli.stream import run_stream


def add_arguments(parser: ArgumentParser) -> None:
    add_node_argument(parser)
    parser.add_argument("parameter_name", help="Name of the parameter")
    parser.add_argument("--hide-type", action="store_true", help="Hide the type information")


def main(args: Namespace) -> int:
    return run_stream(_get(args, find_node(args, args.timeout)))


async def _get(args: Namespace, name: str) -> int:
    async with open_remote(args, name) as remote:
        value = (await remote.values([args.parameter_name]))[0]
        if value.type == 0 and (near := await remote.near(args.parameter_name)):
            complain(f"Node '{name}' has no parameter '{args.parameter_name}'{near}")
    if value.type >= len(LABELS):
        raise CommandError(f"Unknown parameter type '{value.type}'")
    shown = plain(value)
    if args.json:
        record = {"node": name, "parameter": args.parameter_name, "type": TYPE_NAMES[value.type]}
        print_json({**record, "value": listed(shown)})
    elif args.hide_type:
        say(shown)
    else:
        say(LABELS[value.type], *([] if value.type == 0 else [shown]))
    return 0
