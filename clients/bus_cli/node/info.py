"""`bus node info`: the endpoints of a node."""

from argparse import ArgumentParser, Namespace
from collections.abc import Iterable

from bus.graph import GraphEndpoint, services_of
from bus.names import is_hidden_topic
from bus_actions.graph import actions_of
from bus_cli.completion import completed_by, nodes
from bus_cli.origin import origin_record, origin_text, origins
from bus_cli.output import CommandError, complain, print_json, say
from bus_cli.query import get_graph


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(parser.add_argument("node_name", help="Node name to request information"), nodes)
    parser.add_argument("--include-hidden", action="store_true", help="Display hidden topics as well")


def main(args: Namespace) -> int:
    graph = get_graph(args)
    name = args.node_name if args.node_name.startswith("/") else f"/{args.node_name}"
    found = [node for node in graph.nodes if node.full_name == name]
    if not found:
        from bus_cli.suggestions import near_node

        raise CommandError(f"Unable to find node '{args.node_name}'{near_node(name, graph)}")
    if len(found) > 1:
        complain(
            f'There are {len(found)} nodes in the graph with the exact name "{name}". '
            "You are seeing information about only one of them."
        )
    node = found[0]
    is_shown = args.include_hidden or args.include_hidden_topics
    subscribed = [one for one in graph.subscriptions if one.node.id == node.id]
    published = [one for one in graph.publishers if one.node.id == node.id]
    subscriptions, publishers = _topics(subscribed, hidden=is_shown), _topics(published, hidden=is_shown)
    servers, clients = _services(subscribed, hidden=is_shown), _services(published, hidden=is_shown)
    if args.json:
        print_json(
            {
                "node": name,
                "pid": node.pid,
                **origin_record(node),
                "subscribers": subscriptions,
                "publishers": publishers,
                "service_servers": servers,
                "service_clients": clients,
                "action_servers": actions_of(published),
                "action_clients": actions_of(subscribed),
            }
        )
        return 0
    say(name)
    if (origin := origins(graph).get(node.id)) is not None:
        say(f"  Origin: {origin_text(origin)}")
    for title, topics in (
        ("Subscribers", subscriptions),
        ("Publishers", publishers),
        ("Service Servers", servers),
        ("Service Clients", clients),
        ("Action Servers", actions_of(published)),
        ("Action Clients", actions_of(subscribed)),
    ):
        say(f"  {title}:")
        say(*(f"    {topic}: {', '.join(types)}" for topic, types in topics.items()), sep="\n")
    return 0


def _topics(endpoints: Iterable[GraphEndpoint], *, hidden: bool) -> dict[str, list[str]]:
    found: dict[str, set[str]] = {}
    for endpoint in endpoints:
        if hidden or not is_hidden_topic(endpoint.topic):
            found.setdefault(endpoint.topic, set()).add(endpoint.type_name)
    return {topic: sorted(found[topic]) for topic in sorted(found)}


def _services(endpoints: Iterable[GraphEndpoint], *, hidden: bool) -> dict[str, list[str]]:
    """Services with their types. A server takes requests, a client sends them."""
    found = services_of(endpoints)
    return {service: types for service, types in found.items() if hidden or not is_hidden_topic(service)}
