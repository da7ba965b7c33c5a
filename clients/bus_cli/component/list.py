"""`bus component list`: running containers and their components."""

from argparse import ArgumentParser, Namespace

from bus_cli.component.remote import (
    ServiceMissing,
    add_container_argument,
    call,
    containers,
    find_container,
)
from bus_cli.output import CommandError, print_json, say
from bus_cli.query import graph_to_list
from bus_cli.stream import open_node, run_stream

_ANSWER_S = 5.0


def add_arguments(parser: ArgumentParser) -> None:
    add_container_argument(parser, "Name of the container node to list components from", is_optional=True)
    parser.add_argument("--containers-only", action="store_true", help="List found containers nodes only")


def main(args: Namespace) -> int:
    is_single = args.container_node_name is not None
    names = [find_container(args)] if is_single else containers(graph_to_list(args))
    return run_stream(_list(args, names, is_single=is_single)) if names else 0


async def _list(args: Namespace, names: list[str], *, is_single: bool) -> int:
    async with open_node(args) as node:
        for name in names:
            if not args.json and not is_single:
                say(name)
            if args.containers_only:
                if args.json:
                    print_json({"container": name})
                continue
            try:
                response = await call(node, name, "list_nodes", timeout_s=_ANSWER_S)
            except ServiceMissing as missing:
                if is_single:
                    raise CommandError(f"{missing} when listing components in {name}") from None
                say(f"{missing} when listing components")
                continue
            found = list(zip(response.unique_ids, response.full_node_names, strict=False))
            if args.json:
                components = [{"id": unique_id, "node": full_name} for unique_id, full_name in found]
                print_json({"container": name, "components": components})
                continue
            for unique_id, full_name in found:
                say(f"{'' if is_single else '  '}{unique_id}  {full_name}")
    return 0
