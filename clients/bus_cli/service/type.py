"""`bus service type`."""

from argparse import ArgumentParser, Namespace

from bus_cli.completion import completed_by
from bus_cli.output import complain, show
from bus_cli.query import full_topic_name, get_graph
from bus_cli.service.definitions import services


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("service_name", help="Name of the service to get type (e.g. '/add_two_ints')"),
        services,
    )


def main(args: Namespace) -> int:
    service = full_topic_name(args.service_name)
    graph = get_graph(args)
    types = graph.services().get(service, [])
    if not types:
        from bus_cli.suggestions import near_service

        if near := near_service(service, graph):  # else, as in ros2, the status says it
            complain(f"Unknown service '{args.service_name}'{near}")
    for name in types:
        show(name, {"service": service, "type": name}, as_json=args.json)
    return 0 if types else 1
