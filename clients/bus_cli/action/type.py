"""`bus action type`: the type of an action."""

from argparse import ArgumentParser, Namespace

from bus_actions.graph import actions_of
from bus_cli.action.definitions import actions
from bus_cli.completion import completed_by
from bus_cli.query import full_topic_name, get_graph
from bus_cli.type_verb import show_types


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("action_name", help="Name of the ROS action to get type (e.g. '/fibonacci')"),
        actions,
    )


def main(args: Namespace) -> int:
    action = full_topic_name(args.action_name)
    graph = get_graph(args)
    types = actions_of((*graph.publishers, *graph.subscriptions)).get(action, [])
    return show_types("action", action, types, graph, args)
