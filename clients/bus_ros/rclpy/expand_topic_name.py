"""The full name of a topic as it is typed in a node; the rules are those of `bus.names`."""

from bus import names

__all__ = ["expand_topic_name"]


def expand_topic_name(topic_name: str, node_name: str, node_namespace: str) -> str:
    """With `~` and `{node}` put in and the namespace in front; raises ValueError for a wrong name."""
    return names.expand_topic_name(topic_name, node_name, node_namespace)
