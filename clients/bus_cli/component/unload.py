"""`bus component unload`: unload components from a running container."""

from argparse import ArgumentParser, Namespace

from bus_cli.component.remote import add_container_argument, call, find_container
from bus_cli.output import CommandError, print_json, say
from bus_cli.stream import open_node, run_stream, unsigned_int


def add_arguments(parser: ArgumentParser) -> None:
    add_container_argument(parser, "Container node name to unload component from")
    parser.add_argument(
        "component_uid", type=unsigned_int, nargs="+", help="Unique ID of the component to be unloaded"
    )
    parser.add_argument("-q", "--quiet", action="store_true", help="Only print component unique IDs")


def main(args: Namespace) -> int:
    return run_stream(_unload(args, find_container(args)))


async def _unload(args: Namespace, container: str) -> int:
    async with open_node(args) as node:
        for unique_id in args.component_uid:
            response = await call(node, container, "unload_node", unique_id=unique_id)
            if not response.success:
                raise CommandError(
                    f"Failed to unload component {unique_id} from '{container}' container node\n"
                    f"    {response.error_message}"
                )
            if args.json:
                print_json({"container": container, "id": unique_id})
            elif args.quiet:
                say(unique_id)
            else:
                say(f"Unloaded component {unique_id} from '{container}' container node")
    return 0
