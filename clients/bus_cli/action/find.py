"""`bus action find`: actions of a type."""

from argparse import ArgumentParser, Namespace

from bus_actions.graph import actions_of
from bus_cli.action.definitions import action_types, full_action_type
from bus_cli.completion import completed_by
from bus_cli.query import get_graph, show_found


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument(
            "action_type",
            help="Name of the ROS action type to find (e.g. 'example_interfaces/action/Fibonacci')",
        ),
        action_types,
    )
    parser.add_argument(
        "-c", "--count-actions", action="store_true", help="Only display the number of actions discovered"
    )


def main(args: Namespace) -> int:
    wanted = full_action_type(args.action_type)
    graph = get_graph(args)
    actions = actions_of((*graph.publishers, *graph.subscriptions))
    found = [action for action, types in actions.items() if wanted in types]
    return show_found(args, "action", "action", wanted, found, only_count=args.count_actions)
