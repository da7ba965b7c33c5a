"""`bus param describe`: the descriptors of parameters."""

from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from typing import Any

import msgspec

from bus_cli.output import complain, print_json, say
from bus_cli.param.remote import TYPE_NAMES, add_node_argument, find_node, open_remote
from bus_cli.stream import run_stream


def add_arguments(parser: ArgumentParser) -> None:
    add_node_argument(parser)
    parser.add_argument("parameter_names", nargs="+", help="Names of the parameters")


def main(args: Namespace) -> int:
    return run_stream(_describe(args, find_node(args, args.timeout)))


async def _describe(args: Namespace, name: str) -> int:
    async with open_remote(args, name) as remote:
        response = await remote.call("DescribeParameters", names=args.parameter_names)
        for parameter in args.parameter_names:
            if near := await remote.near(parameter):
                complain(f"Node '{name}' has no parameter '{parameter}'{near}")
    for parameter, descriptor in zip(args.parameter_names, response.descriptors, strict=False):
        if args.json:
            ranges = ("integer_range", "floating_point_range")
            record = msgspec.structs.asdict(descriptor)
            record.update({key: [msgspec.structs.asdict(one) for one in record[key]] for key in ranges})
            print_json({**record, "name": parameter, "type": _type_name(descriptor)})
        else:
            say(*_lines(parameter, descriptor), sep="\n")
    return 0


def _type_name(descriptor: Any) -> str:
    return TYPE_NAMES[descriptor.type] if descriptor.type < len(TYPE_NAMES) else "unknown"


def _lines(name: str, descriptor: Any) -> Iterator[str]:
    yield f"Parameter name: {name}"
    yield f"  Type: {_type_name(descriptor)}"
    if descriptor.description:
        yield f"  Description: {descriptor.description}"
    yield "  Constraints:"
    if descriptor.read_only:
        yield "    Read only: true"
    for allowed in (*descriptor.integer_range, *descriptor.floating_point_range):
        yield f"    Min value: {allowed.from_value}"
        yield f"    Max value: {allowed.to_value}"
        if allowed.step:
            yield f"    Step: {allowed.step}"
    if descriptor.additional_constraints:
        yield f"    Additional constraints: {descriptor.additional_constraints}"
