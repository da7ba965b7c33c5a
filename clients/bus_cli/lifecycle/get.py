"""`bus lifecycle get`: the state of one lifecycle node, or of all."""

from argparse import ArgumentParser, Namespace

from bus_cli.lifecycle.remote import add_node_argument, call, find_node, lifecycle_nodes
from bus_cli.output import CommandError, complain, show
from bus_cli.query import get_graph
from bus_cli.stream import open_node, run_stream


def add_arguments(parser: ArgumentParser) -> None:
    add_node_argument(parser, is_optional=True)


def main(args: Namespace) -> int:
    if args.node_name:
        return run_stream(_get(args, [find_node(args)]))
    return run_stream(_get(args, lifecycle_nodes(get_graph(args), are_hidden_too=args.include_hidden_nodes)))


async def _get(args: Namespace, names: list[str]) -> int:
    async with open_node(args) as node:
        for name in names:
            try:
                state = (await call(node, name, "get_state", "GetState")).current_state
            except CommandError as error:
                if args.node_name:
                    raise
                complain(error)
                continue
            prefix = "" if args.node_name else f"{name}: "
            show(
                f"{prefix}{state.label} [{state.id}]",
                {"node": name, "state": state.label, "id": state.id},
                as_json=args.json,
            )
    return 0
