"""`bus service list`: names of services."""

from argparse import ArgumentParser, Namespace

from bus.names import is_hidden_topic
from bus_cli.output import print_json, say, show
from bus_cli.query import graph_to_list


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("-t", "--show-types", action="store_true", help="Additionally show the service type")
    parser.add_argument(
        "-c", "--count-services", action="store_true", help="Only display the number of services discovered"
    )
    parser.add_argument("--include-hidden-services", action="store_true", help="Consider hidden services too")


def main(args: Namespace) -> int:
    graph = graph_to_list(args)
    rows = [
        (service, types)
        for service, types in graph.services().items()
        if args.include_hidden_services or not is_hidden_topic(service)
    ]
    if args.count_services:
        show(len(rows), {"count": len(rows)}, as_json=args.json)
        return 0
    for service, types in rows:
        if args.json:
            servers, clients = len(graph.servers_of(service)), len(graph.clients_of(service))
            print_json({"service": service, "types": types, "servers": servers, "clients": clients})
        else:
            say(f"{service} [{', '.join(types)}]" if args.show_types else service)
    return 0
