"""`bus service find`: services of a type."""

from argparse import ArgumentParser, Namespace

from bus.names import is_hidden_topic
from bus_cli.output import complain, show
from bus_cli.query import get_graph
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
    if not found:
        from bus_cli.suggestions import near_type

        if near := near_type(wanted, "srv"):
            complain(f"no service has the type '{wanted}'{near}")
    if args.count_services:
        show(len(found), {"count": len(found)}, as_json=args.json)
        return 0
    for service in found:
        show(service, {"service": service, "type": wanted}, as_json=args.json)
    return 0
