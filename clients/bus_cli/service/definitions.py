"""What the service verbs have in common: types by name, and the names that the shell completes."""

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
    """`std_srvs/SetBool` as `std_srvs/srv/SetBool`. Raises CommandError for what is no service's type."""
    name = full_type_name(text, "srv")
    if name.split("/")[1] == "msg":
        raise CommandError(f"The passed service type is invalid: {text} is a message, not a service")
    return name


def services(prefix: str, parsed_args: Namespace, **_: Any) -> list[str]:
    """Names of services, for the shell; hidden ones only where the prefix is hidden too."""
    graph = live_graph(parsed_args)
    found = graph.services() if graph else ()
    return [name for name in found if not is_hidden_topic(name) or is_hidden_topic(prefix)]


async def find_service_type(node: "Node", graph: "Graph", service: str, name: str) -> Any:
    """The definition called `name`, as it is served: ready-made, from a file, or made of what is on the bus.

    Raises CommandError where nothing knows it, or the service has another type.
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
