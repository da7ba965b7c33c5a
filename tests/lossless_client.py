"""Clients that are reliable and keep all, on `examples/bare_client.py`.

python tests/lossless_client.py talk       waits for credit
python tests/lossless_client.py relay      acknowledges each sample
"""

import signal
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
from bare_client import Client, Endpoint


class Lossless(Client):
    def __init__(self, role: str) -> None:
        super().__init__(role)
        self.credit = self.window = 0

    def request(self, tag: str, endpoint: Endpoint | None, **fields: Any) -> None:
        super().request(
            tag, endpoint, **fields | ({} if endpoint is None else {"qos": {"history": "keep_all"}})
        )

    def take_created(self, message: dict[Any, Any]) -> None:
        super().take_created(message)
        self.window = message.get("window_samples", 0)
        self.credit = self.endpoints[0].next_seq - 1

    def take_message(self, message: dict[Any, Any]) -> None:
        super().take_message(message)
        if message["m"] == "credit":
            self.take_credit(message["seq"])

    def take_credit(self, seq: int) -> None:
        self.credit = seq

    def talk(self) -> None:
        if self.endpoints[0].next_seq - self.credit <= self.window:
            super().talk()


class LosslessRelay(Client):
    """Its subscription is lossless; its publisher keeps ten."""

    def request(self, tag: str, endpoint: Endpoint | None, **fields: Any) -> None:
        super().request(tag, endpoint, **fields | ({"qos": {"history": "keep_all"}} if tag == "sub+" else {}))

    def take_run(self, frame: bytes) -> None:
        super().take_run(frame)
        (gid,) = self.endpoints[0].last_seqs
        self.acknowledge(self.endpoints[0].last_seqs[gid])

    def acknowledge(self, seq: int) -> None:
        source = [*self.endpoints[0].gids][-1]
        self.send("ack", subscription=self.endpoints[0].id, source=source, seq=seq)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    {"talk": Lossless, "relay": LosslessRelay}[sys.argv[1]](sys.argv[1]).run()
