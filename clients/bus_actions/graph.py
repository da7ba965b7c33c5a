"""The actions in a graph: their names and types, and which nodes serve or call them. Values only."""

from collections.abc import Iterable

from bus.graph import Graph, GraphEndpoint

__all__ = ["action_clients_of", "action_of_topic", "action_servers_of", "actions_of", "actions_of_topics"]

_FEEDBACK = "/_action/feedback"
_SEND_GOAL = "/_action/send_goal"
_MESSAGE = "_FeedbackMessage"


def action_of_topic(topic: str) -> str | None:
    """The action of a feedback topic; None for any other topic."""
    if topic.endswith(_FEEDBACK) and len(topic) > len(_FEEDBACK):
        return topic.removesuffix(_FEEDBACK)
    return None


def actions_of(endpoints: Iterable[GraphEndpoint]) -> dict[str, list[str]]:
    """The actions with feedback `endpoints`, with the names of their types; all sorted."""
    return actions_of_topics((one.topic, one.type_name) for one in endpoints)


def actions_of_topics(topics: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """The same, of topics each with a type."""
    found: dict[str, set[str]] = {}
    for topic, type_name in topics:
        action = action_of_topic(topic)
        if action is not None:
            found.setdefault(action, set()).add(type_name.removesuffix(_MESSAGE))
    return {action: sorted(found[action]) for action in sorted(found)}


def action_servers_of(graph: Graph, action: str) -> list[GraphEndpoint]:
    """The publishers of its feedback, one of each server."""
    serving = {endpoint.node.id for endpoint in graph.servers_of(f"{action}{_SEND_GOAL}")}
    return [one for one in graph.publishers_of(f"{action}{_FEEDBACK}") if one.node.id in serving]


def action_clients_of(graph: Graph, action: str) -> list[GraphEndpoint]:
    """The subscriptions to its feedback, one of each client, without observers' subscriptions."""
    calling = {endpoint.node.id for endpoint in graph.clients_of(f"{action}{_SEND_GOAL}")}
    return [one for one in graph.subscriptions_of(f"{action}{_FEEDBACK}") if one.node.id in calling]
