"""`bus service echo`: the events of a service with introspection, as text."""

from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING, Any

from msgspec import Struct

from bus.errors import ConfigurationError
from bus.qos import services_default
from bus.schema import MessageSchema
from bus.types.support import type_support
from bus_cli.completion import completed_by
from bus_cli.output import CommandError, complain, print_json, say
from bus_cli.query import full_topic_name
from bus_cli.render import TooManyValuesError, to_csv, to_text
from bus_cli.service.definitions import full_service_type, services
from bus_cli.stream import find_class, for_ever, open_node, run_stream
from bus_cli.viewargs import MOST_VALUES, add_view_arguments, view_of

if TYPE_CHECKING:
    from bus.graph import Graph
    from bus.node import Node

_EVENTS = ("REQUEST_SENT", "REQUEST_RECEIVED", "RESPONSE_SENT", "RESPONSE_RECEIVED")
"""Names of event types. The index is the number in service_msgs/msg/ServiceEventInfo."""


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("service_name", help="Name of the service to echo (e.g. '/add_two_ints')"),
        services,
    )
    parser.add_argument(
        "service_type",
        nargs="?",
        help="Type of the service (e.g. 'example_interfaces/srv/AddTwoInts'); default: the service's",
    )
    add_view_arguments(parser)


def main(args: Namespace) -> int:
    service = full_topic_name(args.service_name)
    given = None if args.service_type is None else full_service_type(args.service_type)
    return run_stream(_echo(args, service, given), only_prints=True)


async def _echo(args: Namespace, service: str, given: str | None) -> int:
    topic = f"{service}/_service_event"
    async with open_node(args) as node:
        graph = await node.graph()
        event_type = await _event_class(node, graph, topic, given or _type_of(service, graph))
        schema, view = type_support(event_type).schema, view_of(args)

        def on_event(event: Any) -> None:
            if view.budget is not None:
                view.budget.left = view.budget.most
            try:
                plain = view.plain(schema, schema["root"], event)
            except TooManyValuesError:
                raise CommandError(
                    f"an event of '{service}' has more than {MOST_VALUES:,} values to show, even with arrays "
                    "truncated; --no-arr leaves arrays out, --full-length shows all"
                ) from None
            _print(args, plain)

        await node.create_subscription(event_type, topic, services_default, on_event)
        if not graph.publishers_of(topic):
            complain(
                f"No publishers on topic '{topic}'; is service introspection on the client or server enabled?"
            )
        return await for_ever()


async def _event_class(node: "Node", graph: "Graph", topic: str, service_type: str) -> type[Struct]:
    """The class of a service's events, from the bus or from the service's definition on this machine."""
    name = f"{service_type}_Event"
    if any(one.type_name == name for one in (*graph.publishers, *graph.subscriptions)):
        event_type = await find_class(node, graph, topic, name)
        assert event_type is not None
        return event_type
    from bus_ros.rosidl import message_class

    try:
        definition: Any = message_class(name)
        return MessageSchema.of(definition).to_class()
    except ConfigurationError as error:
        raise CommandError(f"Could not load the type for the passed service: {error}") from None


def _type_of(service: str, graph: "Graph") -> str:
    types = graph.services().get(service, [])
    if len(types) > 1:
        raise CommandError(f"More than one type associated with service '{service}': {', '.join(types)}")
    if not types:
        from bus_cli.suggestions import near_service

        raise CommandError(f"Cannot find type for '{service}'{near_service(service, graph)}")
    return types[0]


def _print(args: Namespace, plain: dict[str, Any]) -> None:
    if args.csv and not args.json:
        say(to_csv(plain))
        return
    number = plain["info"]["event_type"]
    plain["info"]["event_type"] = _EVENTS[number] if number < len(_EVENTS) else number
    if args.json:
        print_json(plain)
    else:
        say(f"{to_text(plain, flow_style=args.flow_style)}---")
