"""A session of zenoh alone: `python zenoh_alone.py listen|connect ENDPOINT`.

Topics are keys, payloads texts.
"""

import json
import sys
from functools import partial
from typing import Any

import zenoh
from orders import serve, tell


class Peer:
    def __init__(self, way: str, endpoint: str) -> None:
        config = zenoh.Config()
        settings: dict[str, object] = {
            "mode": "peer",
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "listen/endpoints": [],
            "connect/exit_on_failure": False,
            f"{way}/endpoints": [endpoint],
        }
        for name, value in settings.items():
            config.insert_json5(name, json.dumps(value))
        self._session = zenoh.open(config)
        self._held: list[Any] = []
        self._publishers: dict[str, Any] = {}

    def publish(self, topic: str) -> None:
        self._publishers[topic] = self._session.declare_publisher(topic)

    def send(self, topic: str, data: str) -> None:
        self._publishers[topic].put(data.encode())

    def listen(self, topic: str) -> None:
        """`topic` may be a key expression."""
        self._held.append(self._session.declare_subscriber(topic, partial(self._hear, topic)))

    def _hear(self, topic: str, sample: Any) -> None:
        size = len(sample.payload)
        text = sample.payload.to_bytes().decode(errors="replace") if size < 1000 else ""
        tell(heard=topic, message={"key": str(sample.key_expr), "data": text, "size": size})

    def matched(self, topic: str) -> list[int]:
        publisher = self._publishers.get(topic)
        return [int(publisher.matching_status.matching) if publisher else 0, 0]

    def tokens(self, key: str) -> list[str]:
        """The liveliness tokens that fit."""
        return [str(reply.ok.key_expr) for reply in self._session.liveliness().get(key) if reply.ok]


if __name__ == "__main__":
    peer = Peer(*sys.argv[1:])
    serve({order: getattr(peer, order) for order in ("publish", "send", "listen", "matched", "tokens")})
