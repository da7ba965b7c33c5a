"""Shared code of the action verbs: types by name, and completion of names in the shell."""

from argparse import Namespace
from typing import TYPE_CHECKING, Any, get_type_hints

from bus.errors import ConfigurationError
from bus_cli.completion import live_graph
from bus_cli.output import CommandError
from bus_cli.query import full_type_name

if TYPE_CHECKING:
    from bus.graph import Graph
    from bus.node import Node

__all__ = ["action_types", "actions", "find_action_type", "full_action_type"]


def full_action_type(text: str) -> str:
    """Expand a type name: `example_interfaces/Fibonacci` is `example_interfaces/action/Fibonacci`.

    Raises CommandError if the name is not the type of an action.
    """
    name = full_type_name(text, "action")
    if (kind := name.split("/")[1]) != "action":
        what = {"msg": "a message", "srv": "a service"}.get(kind, f"a definition of kind {kind!r}")
        raise CommandError(f"The passed action type is invalid: {text} is {what}, not an action")
    return name


def actions(prefix: str, parsed_args: Namespace, **_: Any) -> list[str]:
    """Names of actions, for completion in the shell."""
    return list(_served(parsed_args))


def action_types(prefix: str, parsed_args: Namespace, **_: Any) -> list[str]:
    """Names of types, for completion: the action's types if it is on the bus, else all local definitions."""
    from bus.types.definitions import names

    return _served(parsed_args).get(getattr(parsed_args, "action_name", ""), []) or names("action")


def _served(args: Namespace) -> dict[str, list[str]]:
    """Actions in the current graph, and their types; empty if no busd runs."""
    from bus_actions.graph import actions_of

    graph = live_graph(args)
    return actions_of((*graph.publishers, *graph.subscriptions)) if graph else {}


async def find_action_type(node: "Node", graph: "Graph", action: str, name: str) -> Any:
    """Find the definition `name` in a file, or make it from the types on the bus.

    Raises CommandError if neither knows it, or if the action has another type.
    """
    from bus.types.service import message_of
    from bus.types.support import type_support
    from bus_actions.action_type import action_support, find_action, make_action
    from bus_actions.graph import action_servers_of

    servers = action_servers_of(graph, action)
    served = {one.type_name.removesuffix("_FeedbackMessage"): one.type_hash for one in servers}
    if served and name not in served:
        raise CommandError(f"action '{action}' has the type {min(served)}, not {name}")
    known: Any = None
    try:
        known = find_action(name)
    except ConfigurationError as error:
        if not served:
            from bus_cli.suggestions import near_action

            # The type may be known to the bus alone, if the action's name has a slip.
            near = near_action(action, graph)
            raise CommandError(
                f"no server for '{action}'{near}" if near else f"The passed action type is invalid: {error}"
            ) from None
    hash_here = known and type_support(action_support(known).feedback_message).hash
    if known is not None and served.get(name) in (None, hash_here):
        return known

    async def made(type_name: str, type_hash: str, field: str, *, is_enveloped: bool = True) -> Any:
        carrier = await node.get_type(f"{name}_{type_name}", type_hash)
        return get_type_hints(message_of(carrier) if is_enveloped else carrier)[field]

    begin = f"{action}/_action/"
    asked = graph.subscriptions_of(f"{begin}send_goal/_request")
    answered = graph.publishers_of(f"{begin}get_result/_reply")
    if not asked or not answered:
        raise CommandError(f"action '{action}' has just disappeared")
    return make_action(
        name,
        await made("SendGoal_Request", asked[0].type_hash, "goal"),
        await made("GetResult_Response", answered[0].type_hash, "result"),
        await made("FeedbackMessage", served[name], "feedback", is_enveloped=False),
    )
