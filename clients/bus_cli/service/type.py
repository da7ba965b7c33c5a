"""`bus service type`: the type of a service."""

from argparse import ArgumentParser, Namespace

from bus_cli.completion import completed_by
from bus_cli.query import full_topic_name, get_graph
from bus_cli.service.definitions import services
from bus_cli.type_verb import show_types


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("service_name", help="Name of the service to get type (e.g. '/add_two_ints')"),
        services,
    )


def main(args: Namespace) -> int:
    service = full_topic_name(args.service_name)
    graph = get_graph(args)
    types = graph.services().get(service, [])
    return show_types("service", service, types, graph, args)
