"""Which names are hidden: those with a token that begins with `_`."""

from bus.names import is_hidden_topic

__all__ = ["topic_or_service_is_hidden"]


def topic_or_service_is_hidden(name: str) -> bool:
    return is_hidden_topic(name)
