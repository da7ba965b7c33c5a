"""`bus lifecycle list`: the transitions of a lifecycle node."""

from argparse import ArgumentParser, Namespace

from bus_cli.lifecycle.remote import add_node_argument, call, find_node
from bus_cli.output import show
from bus_cli.stream import open_node, run_stream


def add_arguments(parser: ArgumentParser) -> None:
    add_node_argument(parser)
    parser.add_argument(
        "-a",
        "--all",
        action="store_true",
        help="Display all existing transitions, instead of those from the current state",
    )


def main(args: Namespace) -> int:
    return run_stream(_list(args, find_node(args)))


async def _list(args: Namespace, name: str) -> int:
    service = "get_transition_graph" if args.all else "get_available_transitions"
    async with open_node(args) as node:
        answer = await call(node, name, service, "GetAvailableTransitions")
    for one in answer.available_transitions:
        transition, start, goal = one.transition, one.start_state.label, one.goal_state.label
        show(
            f"- {transition.label} [{transition.id}]\n\tStart: {start}\n\tGoal: {goal}",
            {"id": transition.id, "transition": transition.label, "start": start, "goal": goal},
            as_json=args.json,
        )
    return 0
