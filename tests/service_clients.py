"""A server and a client of a service on `examples/bare_client.py`, for the stories about services.

python tests/service_clients.py serve      serves /add (AddTwoInts)
python tests/service_clients.py call       calls it, one call after the other
"""

import signal
import sys
import time
from pathlib import Path
from typing import Any

import msgspec

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
from bare_client import Client, Endpoint
from bus.srv.example_interfaces import AddTwoInts
from bus.types.service import service_support

SUPPORT = service_support(AddTwoInts)
TYPES: dict[str, Any] = {"_request": SUPPORT.requests, "_reply": SUPPORT.replies(b"")}
ASK_S = 0.5


class ServiceClient(Client):
    """One end of the service /add. A subclass has its role."""

    first = "_reply"
    """The topic of the endpoint that is declared first."""

    def __init__(self, role: str) -> None:
        super().__init__("listen")
        self.role = role
        is_server = role == "serve"
        ends = {
            "_request": Endpoint("/add/_request", is_publisher=not is_server),
            "_reply": Endpoint("/add/_reply", is_publisher=is_server),
        }
        self.requests_end, self.replies_end = ends["_request"], ends["_reply"]
        self.endpoints = sorted(ends.values(), key=lambda one: not one.topic.endswith(self.first))

    def declare(self) -> None:
        for kind in TYPES.values():
            self.send("type", type_name=kind.name, type_hash=kind.hash, schema=kind.description)
        for one in self.endpoints:
            kind = TYPES[one.topic.removeprefix("/add/")]
            seqs: dict[str, Any] = (
                {"next_seq": one.next_seq} if one.is_publisher else {"last_seqs": one.last_seqs}
            )
            fields = {"topic": one.topic, "type_name": kind.name, "type_hash": kind.hash, "gid": one.gid}
            qos = {"depth": 1000} if one.is_publisher else {"history": "keep_all"}
            tag = "pub+" if one.is_publisher else "sub+"
            self.request(tag, one, node=self.node, qos=qos, **fields, **seqs)


class Server(ServiceClient):
    def take_sample(self, payload: bytes) -> None:
        request = SUPPORT.requests.decode(payload)
        if request.body is None:
            self.answer_question(request.client, request.number)
        else:
            self.answer(request.client, request.number, request.body)

    def answer(self, client: bytes, number: int, body: AddTwoInts.Request) -> None:
        response = AddTwoInts.Response(sum=body.a + body.b)
        self.send_sample(self.replies_end, SUPPORT.encode_response(client, number, response))

    def answer_question(self, client: bytes, number: int) -> None:
        """Each call is answered at once, so it works on none."""
        self.send_sample(self.replies_end, SUPPORT.encode_denial(client, number))


class Caller(ServiceClient):
    """Calls, one call after the other. It asks about a call after a lost connection until its end."""

    def __init__(self, role: str) -> None:
        super().__init__(role)
        self.number = 0
        self.waits = False
        self.is_unsure = False
        self.asks_s = 0.0

    def talk(self) -> None:
        if not self.requests_end.gids:
            return
        if not self.waits:
            self.number += 1
            self.waits = True
            request = AddTwoInts.Request(a=self.number, b=1)
            self.send_request(SUPPORT.encode_request(self.requests_end.gid, self.number, request))
        elif self.is_unsure and time.monotonic() >= self.asks_s:
            self.asks_s = time.monotonic() + ASK_S
            self.ask()

    def send_request(self, payload: bytes) -> None:
        self.send_sample(self.requests_end, payload)

    def ask(self) -> None:
        self.send_sample(self.requests_end, SUPPORT.encode_question(self.requests_end.gid, self.number))

    def take_sample(self, payload: bytes) -> None:
        client, number, error, body = msgspec.msgpack.decode(payload)
        if self.is_mine(client, number):
            print(f"{number}: {error or body}", flush=True)
            self.waits = self.is_unsure = False

    def is_mine(self, client: bytes, number: int) -> bool:
        return self.waits and (client, number) == (self.requests_end.gid, self.number)

    def serve(self) -> None:
        self.is_unsure = self.waits
        super().serve()


ROLES = {"serve": Server, "call": Caller}


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    ROLES[sys.argv[1]](sys.argv[1]).run()
