"""`bus service find`: services of a type."""

from argparse import ArgumentParser, Namespace

from bus.names import is_hidden_topic
from bus_cli.query import get_graph, show_found
from bus_cli.service.definitions import full_service_type


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "service_type", help="Name of the service type to filter for (e.g. 'std_srvs/srv/SetBool')"
    )
    parser.add_argument(
        "-c", "--count-services", action="store_true", help="Only display the number of services discovered"
    )
    parser.add_argument("--include-hidden-services", action="store_true", help="Consider hidden services too")


def main(args: Namespace) -> int:
    wanted = full_service_type(args.service_type)
    graph = get_graph(args)
    found = [
        service
        for service, types in graph.services().items()
        if wanted in types and (args.include_hidden_services or not is_hidden_topic(service))
    ]
    return show_found(args, "service", "srv", wanted, found, only_count=args.count_services)
