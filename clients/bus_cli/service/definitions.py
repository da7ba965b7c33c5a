"""Shared code of the service verbs: types by name, and completion of names in the shell."""

from argparse import Namespace
from typing import TYPE_CHECKING, Any

from bus.errors import ConfigurationError
from bus.names import is_hidden_topic, reply_topic
from bus_cli.completion import live_graph
from bus_cli.output import CommandError
from bus_cli.query import full_type_name

if TYPE_CHECKING:
    from bus.graph import Graph
    from bus.node import Node

__all__ = ["find_service_type", "full_service_type", "services"]


def full_service_type(text: str) -> str:
    """Expand a type name: `std_srvs/SetBool` is `std_srvs/srv/SetBool`.

    Raises CommandError if the name is not the type of a service.
    """
    name = full_type_name(text, "srv")
    if name.split("/")[1] == "msg":
        raise CommandError(f"The passed service type is invalid: {text} is a message, not a service")
    return name


def services(prefix: str, parsed_args: Namespace, **_: Any) -> list[str]:
    """Names of services, for completion in the shell; hidden ones only if the prefix is hidden, too."""
    graph = live_graph(parsed_args)
    found = graph.services() if graph else ()
    return [name for name in found if not is_hidden_topic(name) or is_hidden_topic(prefix)]


async def find_service_type(node: "Node", graph: "Graph", service: str, name: str) -> Any:
    """Find the definition `name` ready-made or in a file, or make it from the types on the bus.

    Raises CommandError if none of these knows it, or if the service has another type.
    """
    from bus.srv import make_service
    from bus.types.classes import service_class
    from bus.types.service import message_of, service_support

    served = {one.type_name.removesuffix("_Request"): one.type_hash for one in graph.servers_of(service)}
    if served and name not in served:
        raise CommandError(f"service '{service}' has the type {min(served)}, not {name}")
    known: Any = None
    try:
        known = service_class(name)
    except ConfigurationError as error:
        if not served:
            raise CommandError(f"The passed service type is invalid: {error}") from None
    if known is not None and served.get(name) in (None, service_support(known).requests.hash):
        return known
    replies = graph.publishers_of(reply_topic(service))
    answered = [one.type_hash for one in replies if one.type_name == f"{name}_Response"]
    if not answered:
        raise CommandError(f"service '{service}' has just disappeared")
    request = await node.get_type(f"{name}_Request", served[name])
    response = await node.get_type(f"{name}_Response", answered[0])
    return make_service(name, message_of(request), message_of(response))
