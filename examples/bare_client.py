"""A client of the bus without the library: a socket and MessagePack, as docs/protocol.md describes them.

    python examples/bare_client.py talk        publishes "Hello World: 1" and so on, on /topic
    python examples/bare_client.py listen      prints what comes on /topic
    python examples/bare_client.py relay       publishes on /conformance/out what comes on /conformance/in

It begins with a running busd, uses the route socket only, and connects again if busd restarts. It is a
pattern for clients in other languages: bus doctor --conformance -- python examples/bare_client.py relay
"""

import os
import select
import signal
import socket
import struct
import sys
import time
from dataclasses import dataclass, field
from typing import Any

import msgspec

STRING = "std_msgs/msg/String"
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
STRING_SCHEMA = {
    "root": STRING,
    "types": {STRING: {"array": True, "fields": [{"name": "data", "type": "string"}]}},
}

CONTROL, DATA = 1, 2
FRAME = struct.Struct("<IBBH")
RUN = struct.Struct("<IBBHIIQII")
RECORD = struct.Struct("<Iq")

PERIOD_S = 0.5
RETRY_S, GIVE_UP_S = 0.1, 10.0


@dataclass
class Endpoint:
    """A publisher or a subscription."""

    topic: str
    is_publisher: bool
    gid: bytes = field(default_factory=lambda: os.urandom(16))
    id: int = 0
    """From busd; 0: busd has not created it on this connection."""
    max_bytes: int = 0
    """From busd: the longest message."""
    next_seq: int = 1
    last_seqs: dict[bytes, int] = field(default_factory=dict)
    """The last number received, by the gid of the publisher."""
    gids: dict[int, bytes] = field(default_factory=dict)
    """The gids of the publishers, by their ids."""


class ConnectionLost(Exception):
    """busd has closed the connection."""


class Client:
    """One node with its endpoints, and the connection to busd."""

    def __init__(self, role: str) -> None:
        topics = {
            "talk": [Endpoint("/topic", is_publisher=True)],
            "listen": [Endpoint("/topic", is_publisher=False)],
            "relay": [
                Endpoint("/conformance/in", is_publisher=False),
                Endpoint("/conformance/out", is_publisher=True),
            ],
        }
        self.role = role
        self.endpoints = topics[role]
        self.requests = 0
        self.pending: dict[int, Endpoint | None] = {}
        self.node = 0
        self.lease_s = 1.0
        self.sent_s = 0.0
        self.buffer = b""
        self.said = 0

    # --- frames

    def send(self, tag: str, **fields: Any) -> None:
        body = msgspec.msgpack.encode({"m": tag, **fields})
        self.write(FRAME.pack(4 + len(body), CONTROL, 0, 0) + body)

    def send_sample(self, endpoint: Endpoint, payload: bytes) -> None:
        if len(payload) > endpoint.max_bytes:
            most = f"{endpoint.max_bytes} bytes are the limit"
            print(f"a message of {len(payload)} bytes on {endpoint.topic} dropped: {most}", file=sys.stderr)
            return
        record = RECORD.pack(len(payload), time.monotonic_ns()) + payload
        seq = endpoint.next_seq
        endpoint.next_seq += 1
        self.write(RUN.pack(28 + len(record), DATA, 0, 0, endpoint.id, 0, seq, 1, 0) + record)

    def write(self, raw: bytes) -> None:
        self.sent_s = time.monotonic()
        try:
            self.socket.sendall(raw)
        except ConnectionError:
            raise ConnectionLost from None

    def frames(self) -> list[bytes]:
        """The frames in what has arrived, each without its length."""
        found = []
        while len(self.buffer) >= 4:
            end = 4 + int.from_bytes(self.buffer[:4], "little")
            if len(self.buffer) < end:
                break
            found.append(self.buffer[4:end])
            self.buffer = self.buffer[end:]
        return found

    # --- what busd sends

    def take(self, frame: bytes) -> None:
        if frame[0] == CONTROL:
            self.take_message(msgspec.msgpack.decode(frame[4:]))
        elif frame[0] == DATA:
            self.take_run(frame)

    def take_message(self, message: dict[Any, Any]) -> None:
        match message["m"]:
            case "hello":
                self.lease_s = message.get("lease_s", 0.0) or 10.0
                self.request("node+", None, name=f"bare_{self.role}")
            case "created":
                self.take_created(message)
            case "refused":
                sys.exit(f"busd refuses: {message['text']}")
            case "fault":
                print(f"busd: {message['text']}", file=sys.stderr)
                raise ConnectionLost
            case "matched":
                for endpoint in self.endpoints:
                    if endpoint.id == message["endpoint"]:
                        endpoint.gids[message["other"]] = message["gid"]
            case _:
                pass  # not needed here

    def take_created(self, message: dict[Any, Any]) -> None:
        endpoint = self.pending.pop(message["request"])
        if endpoint is not None:
            endpoint.id, endpoint.max_bytes = message["id"], message.get("max_message_bytes", 0)
            return
        self.node = message["id"]
        self.declare()

    def take_run(self, frame: bytes) -> None:
        _, _, _, _, endpoint_id, source, first_seq, count, _ = RUN.unpack_from(b"\0" * 4 + frame)
        endpoint = next(one for one in self.endpoints if one.id == endpoint_id)
        gid = endpoint.gids[source]
        at = RUN.size - 4
        for seq in range(first_seq, first_seq + count):
            size, _stamp_ns = RECORD.unpack_from(frame, at)
            at += RECORD.size
            if seq > endpoint.last_seqs.get(gid, 0):  # else it comes again
                endpoint.last_seqs[gid] = seq
                self.take_sample(frame[at : at + size])
            at += size

    def take_sample(self, payload: bytes) -> None:
        if self.role == "relay":
            self.send_sample(self.endpoints[1], payload)
        else:
            print(f"I heard: {msgspec.msgpack.decode(payload)[0]}", flush=True)

    # --- declarations

    def request(self, tag: str, endpoint: Endpoint | None, **fields: Any) -> None:
        self.requests += 1
        self.pending[self.requests] = endpoint
        self.send(tag, request=self.requests, **fields)

    def declare(self) -> None:
        schema = msgspec.msgpack.encode(STRING_SCHEMA)
        self.send("type", type_name=STRING, type_hash=STRING_HASH, schema=schema)
        for endpoint in self.endpoints:
            fields: dict[str, Any] = {"next_seq": endpoint.next_seq}
            if not endpoint.is_publisher:
                fields = {"last_seqs": endpoint.last_seqs}
            self.request(
                "pub+" if endpoint.is_publisher else "sub+",
                endpoint,
                node=self.node,
                topic=endpoint.topic,
                type_name=STRING,
                type_hash=STRING_HASH,
                qos={},
                gid=endpoint.gid,
                **fields,
            )

    # --- the connection

    def run(self) -> None:
        lost_s = time.monotonic()
        while time.monotonic() - lost_s < GIVE_UP_S:
            with socket.socket(socket.AF_UNIX) as self.socket:
                try:
                    self.socket.connect(path())
                    self.serve()
                except ConnectionLost:
                    lost_s = time.monotonic()
                except OSError:
                    pass  # busd is not there
            time.sleep(RETRY_S)
        sys.exit(f"no busd at {path()}")

    def serve(self) -> None:
        """One connection, to its end."""
        self.buffer, self.requests = b"", 0
        for endpoint in self.endpoints:
            endpoint.id = 0
            endpoint.gids.clear()
        self.send("hello", version=1, pid=os.getpid(), program="bare_client.py")
        talk_s = time.monotonic() + PERIOD_S
        try:
            while True:
                now_s = time.monotonic()
                wait_s = min(self.sent_s + self.lease_s / 3, talk_s) - now_s
                if select.select([self.socket], [], [], max(wait_s, 0))[0]:
                    self.read()
                if time.monotonic() >= talk_s:
                    talk_s += PERIOD_S
                    self.talk()
                if time.monotonic() - self.sent_s >= self.lease_s / 3:
                    self.send("ping")
        except KeyboardInterrupt:
            self.send("node-", node=self.node)
            sys.exit(0)

    def read(self) -> None:
        try:
            raw = self.socket.recv(65536)
        except ConnectionError:
            raw = b""
        if not raw:
            raise ConnectionLost
        self.buffer += raw
        for frame in self.frames():
            self.take(frame)

    def talk(self) -> None:
        if self.role == "talk" and self.endpoints[0].id:
            self.said += 1
            self.send_sample(self.endpoints[0], msgspec.msgpack.encode([f"Hello World: {self.said}"]))


def path() -> str:
    """The socket's path, as docs/configuration.md has it."""
    if chosen := os.environ.get("BUSD_SOCKET"):
        return chosen
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    return f"{runtime}/busd/0.sock" if runtime else f"/tmp/busd-{os.getuid()}/0.sock"


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    Client(sys.argv[1]).run()
