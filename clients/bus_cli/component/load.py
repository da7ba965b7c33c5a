"""`bus component load`: load a component into a running container."""

from argparse import ArgumentParser, Namespace

from bus_cli.component.remote import (
    add_component_arguments,
    add_container_argument,
    find_container,
    load,
)
from bus_cli.output import print_json, say
from bus_cli.stream import open_node, run_stream


def add_arguments(parser: ArgumentParser) -> None:
    add_container_argument(parser, "Container node name to load component into")
    add_component_arguments(parser)
    parser.add_argument(
        "-q", "--quiet", action="store_true", help="Only print component unique IDs and names"
    )


def main(args: Namespace) -> int:
    return run_stream(_load(args, find_container(args)))


async def _load(args: Namespace, container: str) -> int:
    async with open_node(args) as node:
        unique_id, name = await load(node, container, args)
    if args.json:
        print_json({"container": container, "id": unique_id, "node": name})
    elif args.quiet:
        say(f"{unique_id}  {name}")
    else:
        say(f"Loaded component {unique_id} into '{container}' container node as '{name}'")
    return 0
