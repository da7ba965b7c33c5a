"""`bus service info`: the type of a service, and the numbers of its servers and clients."""

from argparse import ArgumentParser, Namespace

from bus_cli.completion import completed_by
from bus_cli.output import CommandError, print_json, say
from bus_cli.query import full_topic_name, get_graph
from bus_cli.service.definitions import services


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("service_name", help="Name of the service to get info (e.g. '/add_two_ints')"),
        services,
    )


def main(args: Namespace) -> int:
    service = full_topic_name(args.service_name)
    graph = get_graph(args)
    types = graph.services().get(service)
    if types is None:
        from bus_cli.suggestions import near_service

        raise CommandError(f"Unknown service '{args.service_name}'{near_service(service, graph)}")
    clients, servers = len(graph.clients_of(service)), len(graph.servers_of(service))
    if args.json:
        print_json({"service": service, "types": types, "clients_count": clients, "services_count": servers})
    else:
        say(f"Type: {types[0] if len(types) == 1 else types}")
        say(f"Clients count: {clients}")
        say(f"Services count: {servers}")
    return 0
