"""`bus action type`."""

from argparse import ArgumentParser, Namespace

from bus_actions.graph import actions_of
from bus_cli.action.definitions import actions
from bus_cli.completion import completed_by
from bus_cli.output import complain, show
from bus_cli.query import full_topic_name, get_graph


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("action_name", help="Name of the ROS action to get type (e.g. '/fibonacci')"),
        actions,
    )


def main(args: Namespace) -> int:
    action = full_topic_name(args.action_name)
    graph = get_graph(args)
    types = actions_of((*graph.publishers, *graph.subscriptions)).get(action, [])
    if not types:
        from bus_cli.suggestions import near_action

        if near := near_action(action, graph):  # else, as in ros2, the status says it
            complain(f"Unknown action '{args.action_name}'{near}")
    for name in types:
        show(name, {"action": action, "type": name}, as_json=args.json)
    return 0 if types else 1
