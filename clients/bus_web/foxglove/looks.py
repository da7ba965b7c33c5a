"""The topics that one client looks at, for one reason or several."""

from bus_web.shared_subscriptions import Listener, SharedSubscriptions

__all__ = ["Looks"]


class Looks:
    """As long as there is a reason, the `listener` receives the messages of a topic."""

    def __init__(self, subscriptions: SharedSubscriptions, listener: Listener) -> None:
        self._subscriptions = subscriptions
        self._listener = listener
        self._reasons: dict[str, set[str]] = {}

    def add(self, topic: str, reason: str) -> None:
        if topic not in self._reasons:
            self._reasons[topic] = set()
            self._subscriptions.add(topic, self._listener, is_last_wanted=False)
        self._reasons[topic].add(reason)

    def remove(self, topic: str, reason: str) -> None:
        """Remove a reason; without effect if there was no such reason."""
        reasons = self._reasons.get(topic)
        if reasons is None:
            return
        reasons.discard(reason)
        if not reasons:
            del self._reasons[topic]
            self._subscriptions.remove(topic, self._listener)

    def close(self) -> None:
        """Look at nothing."""
        while self._reasons:
            topic, _ = self._reasons.popitem()
            self._subscriptions.remove(topic, self._listener)
