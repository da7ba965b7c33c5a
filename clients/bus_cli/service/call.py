"""`bus service call`: send a request given as YAML, and print the answer."""

import asyncio
from argparse import ArgumentParser, Namespace
from typing import Any

from bus.service.client import ServiceClient
from bus.types.support import type_support
from bus_cli.completion import completed_by
from bus_cli.documents import add_values_arguments, given_value
from bus_cli.output import complain, print_json, say
from bus_cli.populate import Prototype
from bus_cli.query import full_topic_name
from bus_cli.render import View
from bus_cli.service.definitions import find_service_type, full_service_type, services
from bus_cli.stream import open_node, positive, run_stream


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("service_name", help="Name of the service to call to (e.g. '/add_two_ints')"),
        services,
    )
    parser.add_argument("service_type", help="Type of the service (e.g. 'std_srvs/srv/Empty')")
    add_values_arguments(
        parser,
        "values",
        'Values to fill the service request with in YAML format (e.g. "{a: 1, b: 2}"), otherwise the '
        "service request will be published with default values",
        stdin_help="Read values from standard input",
    )
    parser.add_argument(
        "-r", "--rate", metavar="N", type=positive, help="Repeat the call at a specific rate in Hz"
    )


def main(args: Namespace) -> int:
    # Before anything else, report mistakes in the command line itself.
    name, values = full_service_type(args.service_type), given_value(args)
    service = full_topic_name(args.service_name)
    return run_stream(_call(args, service, name, values))


async def _call(args: Namespace, service: str, name: str, values: Any) -> int:
    async with open_node(args) as node:
        graph = await node.graph()
        definition = await find_service_type(node, graph, service, name)
        prototype = Prototype(definition.Request, values)
        client = await node.create_client(definition, service)
        if not client.statistics().servers:
            from bus_cli.suggestions import near_service

            if not args.json:
                say("waiting for service to become available...")
            if near := near_service(service, graph):
                complain(f"no server for '{service}'{near}")
        await client.wait_for_service()
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        while True:
            prototype.stamp()
            await _call_once(client, prototype.message, as_json=args.json)
            if args.rate is None:
                return 0
            due_s = max(due_s + 1 / args.rate, loop.time())
            await asyncio.sleep(due_s - loop.time())


async def _call_once(client: ServiceClient, request: Any, *, as_json: bool) -> None:
    if not as_json:
        say(f"requester: making request: {request!r}\n")
    response = await client.call(request)
    if as_json:
        schema = type_support(type(response)).schema
        print_json({"response": View(octets=True).plain(schema, schema["root"], response)})
    else:
        say(f"response:\n{response!r}\n")
