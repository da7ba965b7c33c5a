"""`bus action info`: the servers and clients of an action."""

from argparse import ArgumentParser, Namespace
from collections.abc import Iterable

from bus.graph import GraphEndpoint
from bus_actions.graph import action_clients_of, action_servers_of, actions_of
from bus_cli.action.definitions import actions
from bus_cli.completion import completed_by
from bus_cli.output import complain, print_json, say
from bus_cli.query import full_topic_name, get_graph


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("action_name", help="Name of the ROS action to get info (e.g. '/fibonacci')"),
        actions,
    )
    parser.add_argument("-t", "--show-types", action="store_true", help="Additionally show the action type")
    parser.add_argument(
        "-c",
        "--count",
        action="store_true",
        help="Only display the number of action clients and action servers",
    )


def main(args: Namespace) -> int:
    action = full_topic_name(args.action_name)
    graph = get_graph(args)
    clients = _nodes(action_clients_of(graph, action))
    servers = _nodes(action_servers_of(graph, action))
    if args.json:
        types = actions_of((*graph.publishers, *graph.subscriptions)).get(action, [])
        print_json({"action": action, "types": types, "clients": list(clients), "servers": list(servers)})
        return 0
    if not clients and not servers:
        from bus_cli.suggestions import near_action

        if near := near_action(action, graph):
            complain(f"Unknown action '{args.action_name}'{near}")
    say(f"Action: {args.action_name}")
    for title, found in (("clients", clients), ("servers", servers)):
        say(f"Action {title}: {len(found)}")
        for node, types in found.items():
            if not args.count:
                say(f"    {node} [{', '.join(types)}]" if args.show_types else f"    {node}")
    return 0


def _nodes(endpoints: Iterable[GraphEndpoint]) -> dict[str, list[str]]:
    """Nodes of the endpoints, with the types that the action has there."""
    found: dict[str, list[GraphEndpoint]] = {}
    for endpoint in endpoints:
        found.setdefault(endpoint.node.full_name, []).append(endpoint)
    return {node: next(iter(actions_of(found[node]).values())) for node in sorted(found)}
