"""A client of docs/protocol.md that ignores all rules of politeness, without busd's own code.

    with Client() as client:                    Hello is done
        node = client.node()
        number = client.publisher(endpoint(node, "/t"))
        client.write(run(number, 1, 1, records([b"..."])))
        client.barrier()                        busd has handled everything sent; input is discarded

Raises OSError: ConnectionError if busd disconnects it, TimeoutError if busd is silent for long.
"""

import array
import os
import socket
import struct
from collections.abc import Iterable, Iterator
from itertools import count
from time import monotonic, monotonic_ns, sleep
from typing import Any, Self

import msgspec

Fields = dict[str, Any]

CONTROL, DATA = 1, 2
QOS: Fields = {
    "depth": 10,
    "history": "keep_last",
    "reliability": "reliable",
    "durability": "volatile",
    "deadline": None,
    "lifespan": None,
    "liveliness": "automatic",
    "liveliness_lease_duration": None,
}
TYPE: Fields = {"type_name": "hostile/msg/Bytes", "type_hash": "none"}

_TIMEOUT_S = 20.0
_AGAIN_S = 0.005
_READ_BYTES = 1 << 18
_LENGTH_BYTES = 4
_HEAD = struct.Struct("<IBBH")
_RUN_HEAD = struct.Struct("<IBBHIIQII")
_RECORD_HEAD = struct.Struct("<Iq")
_gids = count(1)


def control(tag: str, **fields: Any) -> bytes:
    """Make a control frame."""
    body = msgspec.msgpack.encode({"m": tag, **fields})
    return _HEAD.pack(_HEAD.size - _LENGTH_BYTES + len(body), CONTROL, 0, 0) + body


def records(payloads: Iterable[bytes]) -> bytes:
    """The body of a run: these samples, stamped now."""
    now_ns = monotonic_ns()
    return b"".join(_RECORD_HEAD.pack(len(payload), now_ns) + payload for payload in payloads)


def run(publisher: int, first_seq: int, samples: int, body: bytes) -> bytes:
    """Make a data frame of `samples` samples, with the records in `body`."""
    length = _RUN_HEAD.size - _LENGTH_BYTES + len(body)
    return _RUN_HEAD.pack(length, DATA, 0, 0, publisher, 0, first_seq, samples, 0) + body


def endpoint(node: int, topic: str, qos: Fields | None = None, **changes: Any) -> Fields:
    """The fields of a declaration, without the number of its request."""
    gid = struct.pack("<QQ", os.getpid(), next(_gids))
    return {"node": node, "topic": topic, **TYPE, "qos": {**QOS, **(qos or {})}, "gid": gid, **changes}


def _connect(client: socket.socket) -> None:
    """Connect. The kernel refuses at once if more clients connect than busd accepts."""
    end_s = monotonic() + _TIMEOUT_S
    while True:
        try:
            client.connect(os.environ["BUSD_SOCKET"])
            return
        except BlockingIOError:
            if monotonic() > end_s:
                raise
            sleep(_AGAIN_S)


class Client:
    """One connection."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_UNIX)
        self._buffer, self._at = bytearray(), 0
        self._requests = count(1)
        try:
            self.socket.settimeout(_TIMEOUT_S)
            _connect(self.socket)
            self.write(control("hello", version=1, pid=os.getpid(), program="hostile"))
            self._expect("hello")
        except BaseException:
            self.socket.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self.socket.close()

    def fileno(self) -> int:
        return self.socket.fileno()

    # --- output

    def write(self, data: bytes) -> None:
        """Write all data; waits for room."""
        self.socket.sendall(data)

    def write_some(self, data: bytes | memoryview) -> int:
        """Write as much as the socket accepts at once; returns the number of bytes."""
        try:
            return self.socket.send(data, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return 0

    def send(self, tag: str, **fields: Any) -> None:
        self.write(control(tag, **fields))

    def carry(self, data: bytes, *descriptors: int) -> None:
        """Send a frame with descriptors."""
        rights = array.array("i", descriptors)
        self.socket.sendmsg([data], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, rights)])

    # --- input

    def forget(self, limit: int = _READ_BYTES) -> int:
        """Read available data, at most `limit` bytes, and discard it; returns the number of bytes.

        A client that discards part of a frame can't understand later input.
        """
        try:
            size = len(self.socket.recv(limit, socket.MSG_DONTWAIT))
        except BlockingIOError:
            return 0
        if not size:
            raise ConnectionResetError("busd has ended the connection")
        return size

    def barrier(self) -> None:
        """Wait until busd has handled everything sent; discards all other input."""
        self.send("ping", number=1)
        self._expect("pong")

    def ask(self, *requests: tuple[str, Fields]) -> list[Fields]:
        """Send all requests at once; returns the answers, in order. Discards other input."""
        numbers = [next(self._requests) for _ in requests]
        pairs = zip(numbers, requests, strict=True)
        self.write(b"".join(control(tag, request=number, **fields) for number, (tag, fields) in pairs))
        return self.answers(numbers)

    def answers(self, numbers: list[int]) -> list[Fields]:
        """Read the answers to the requests with these numbers, in order. Discards other input."""
        waiting, answers = set(numbers), dict[int, Fields]()
        for body in self._bodies():
            message = msgspec.msgpack.decode(body)
            if message["m"] == "fault":
                raise ConnectionResetError(message["text"])
            if (number := message.get("request")) in waiting:
                answers[number] = message
                if len(answers) == len(numbers):
                    break
        return [answers[number] for number in numbers]

    def _expect(self, tag: str) -> None:
        mark = msgspec.msgpack.encode(tag)  # avoids decoding most of the input
        for body in self._bodies():
            if mark in body and msgspec.msgpack.decode(body)["m"] == tag:
                return

    def _bodies(self) -> Iterator[bytearray]:
        """The bodies of control frames as they arrive. Unused input stays for the next call.

        The kernel closes descriptors in the input, because the call has no room for them.
        """
        while True:
            while len(self._buffer) - self._at >= _HEAD.size:
                length, kind, _, _ = _HEAD.unpack_from(self._buffer, self._at)
                begin, end = self._at + _HEAD.size, self._at + _LENGTH_BYTES + length
                if end > len(self._buffer):
                    break
                self._at = end
                if kind == CONTROL:
                    yield self._buffer[begin:end]
            del self._buffer[: self._at]
            self._at = 0
            data = self.socket.recv(_READ_BYTES)
            if not data:
                raise ConnectionResetError("busd has ended the connection")
            self._buffer += data

    # --- common first requests

    def node(self, name: str = "hostile", **kind: str) -> int:
        """Declare a node and a type (by default `TYPE`); returns the node's id."""
        self.send("type", **{**TYPE, **kind}, schema=b"\xc0")
        (answer,) = self.ask(("node+", {"name": name, "namespace": "/"}))
        return self._id(answer)

    def publisher(self, fields: Fields) -> int:
        """Declare a publisher with fields from `endpoint`; returns its id."""
        (answer,) = self.ask(("pub+", fields))
        return self._id(answer)

    def subscription(self, fields: Fields) -> int:
        """Declare a subscription with fields from `endpoint`; returns its id."""
        (answer,) = self.ask(("sub+", fields))
        return self._id(answer)

    @staticmethod
    def _id(answer: Fields) -> int:
        """The id in an answer. Raises ConnectionRefusedError if busd refused the request."""
        if answer["m"] != "created":
            raise ConnectionRefusedError(answer["text"])
        return int(answer["id"])
