"""`bus service type`."""

from argparse import ArgumentParser, Namespace

from bus.cli.completion import completed_by
from bus.cli.output import print_json, say
from bus.cli.query import full_topic_name, get_graph
from bus.cli.service.definitions import services


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("service_name", help="Name of the service to get type (e.g. '/add_two_ints')"),
        services,
    )


def main(args: Namespace) -> int:
    service = full_topic_name(args.service_name)
    types = get_graph(args).services().get(service, [])
    for name in types:
        if args.json:
            print_json({"service": service, "type": name})
        else:
            say(name)
    return 0 if types else 1
