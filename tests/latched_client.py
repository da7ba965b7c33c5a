"""A talker that is transient local, on `examples/bare_client.py`: it sends its history to each busd.

python tests/latched_client.py talk
"""

import signal
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
from bare_client import RECORD, RUN, Client, Endpoint

DEPTH = 3


class Latched(Client):
    def __init__(self, role: str) -> None:
        super().__init__(role)
        self.history: list[bytes] = []
        """The records of the last samples."""

    def request(self, tag: str, endpoint: Endpoint | None, **fields: Any) -> None:
        if endpoint is not None:
            fields["qos"] = {"durability": "transient_local", "depth": DEPTH}
            fields["next_seq"] = self.first_seq()
        super().request(tag, endpoint, **fields)

    def first_seq(self) -> int:
        return self.endpoints[0].next_seq - len(self.history)

    def take_created(self, message: dict[Any, Any]) -> None:
        super().take_created(message)
        if self.endpoints[0].id and self.history:
            self.send_records(self.first_seq(), self.history)

    def send_sample(self, endpoint: Endpoint, payload: bytes) -> None:
        record = RECORD.pack(len(payload), time.monotonic_ns()) + payload
        self.send_records(endpoint.next_seq, [record])
        endpoint.next_seq += 1
        self.history = [*self.history, record][-DEPTH:]

    def send_records(self, first_seq: int, records: list[bytes]) -> None:
        body = b"".join(records)
        self.write(
            RUN.pack(28 + len(body), 2, 0, 0, self.endpoints[0].id, 0, first_seq, len(records), 0) + body
        )


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    Latched(sys.argv[1]).run()
