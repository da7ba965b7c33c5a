"""The subscriptions of one client, under the ids that it has chosen. Pure."""

__all__ = ["MOST", "Subscriptions"]

MOST = 4096


class Subscriptions:
    """At most one subscription for each topic."""

    def __init__(self) -> None:
        self._topics: dict[int, str] = {}
        self._ids: dict[str, int] = {}

    def topic_of(self, id: int) -> str | None:
        return self._topics.get(id)

    def id_of(self, topic: str) -> int | None:
        """Messages are sent under it; None if the client has not subscribed."""
        return self._ids.get(topic)

    def add(self, id: int, topic: str) -> str:
        """Returns the reason for a refusal; an empty text if the subscription was added."""
        if id in self._topics:
            return f"there is a subscription {id} already"
        if topic in self._ids:
            return f"{topic} is subscribed to already"
        if len(self._topics) >= MOST:
            return f"a client can have at most {MOST} subscriptions"
        self._topics[id] = topic
        self._ids[topic] = id
        return ""

    def remove(self, topic: str) -> bool:
        """Returns whether there was one."""
        id = self._ids.pop(topic, None)
        if id is None:
            return False
        del self._topics[id]
        return True
