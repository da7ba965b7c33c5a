"""A hostile busd for the C client: it answers so many requests, then sends nonsense.

It uses blocking sockets, so it runs in a thread. All choices come from one seed.
"""

import fcntl
import mmap
import os
import random
import socket
import struct
import threading
from pathlib import Path
from typing import Any

import msgspec

from conftest import WAIT_S

CONTROL, DATA = 1, 2
SEALS = 1 | 2 | 4 | 16
TAGS = """
    matched matched matched attached attached ring* ring* unmatched rerouted credit silence dropped
    incompatible liveliness lost namesake created refused done pong type= peers new
    graph graph* graph* graph* graph*
""".split()  # noqa: SIM905
FIELDS = """
    endpoint other publisher subscription source slot process pid request id seq at_ns next_seq
    last_seq clock_ns lost is_over is_tap depth max_message_bytes window_samples window_bytes
    ring_bytes text node policy program dropped lifespan
""".split()  # noqa: SIM905
GRAPH_LISTS = [
    *("nodes", "endpoints", "matches"),
    *(f"{kind}_{change}" for kind in ("nodes", "endpoints", "matches") for change in ("added", "removed")),
]
NODES = [{"id": number, "name": "n", "namespace": "/", "pid": 1} for number in range(2)]
POLICIES = {"history": "keep_all", "durability": "transient_local", "reliability": "best_effort"}
RING_HEADER, CAPACITY, INDEX = 640, 4096, 64
RING_BYTES = RING_HEADER + 8 * INDEX + CAPACITY
READERS_BYTES = 256 + 64 * 16


class HostileBusd:
    def __init__(self, path: Path, seed: int, *, requests: int) -> None:
        self._requests = requests
        self._source = random.Random(seed)
        self._listening = socket.socket(socket.AF_UNIX)
        self._listening.bind(str(path))
        self._listening.listen()
        self._memories: list[mmap.mmap] = []
        self._revision = 1
        self.faults = 0
        self.may_begin = threading.Event()
        """The program is ready: nonsense before that would be the answer to its first requests."""

    def close(self) -> None:
        self._listening.shutdown(socket.SHUT_RDWR)  # wakes `serve`, which may wait for a client
        self._listening.close()
        for memory in self._memories:
            memory.close()

    def serve(self, connections: int, frames: int) -> None:
        """Serve so many connections, one after the other, with at most so many frames of nonsense each."""
        for _ in range(connections):
            connection, _ = self._listening.accept()
            with connection:
                connection.settimeout(10)
                try:
                    ids = self._declare(connection)
                    self.may_begin.wait(WAIT_S)
                    for _ in range(frames):
                        self._send_nonsense(connection, ids)
                    self._read_rest(connection)
                except ConnectionError:
                    self.faults += 1  # the client has noticed, and left

    # --- the honest part

    def _declare(self, connection: socket.socket) -> list[int]:
        self._frame(connection, {"m": "hello", "version": 1, "lease_s": 10.0})
        ids: list[int] = []
        buffer = b""
        answers = 0
        while answers < self._requests:
            raw = connection.recv(65536)
            if not raw:
                raise ConnectionError
            buffer += raw
            while len(buffer) >= 4 and len(buffer) >= 4 + (length := struct.unpack_from("<I", buffer)[0]):
                kind, body = buffer[4], buffer[8 : 4 + length]
                buffer = buffer[4 + length :]
                message = msgspec.msgpack.decode(body) if kind == CONTROL else {}
                graph = {"m": "graph", "revision": 1, "nodes": NODES, "endpoints": [], "matches": []}
                if message.get("m") in ("node+", "pub+", "sub+"):
                    ids.append(len(ids) + 1)
                    answer = {"m": "created", "request": message["request"], "id": ids[-1], "depth": 0}
                    limits = {"max_message_bytes": 1 << 20, "window_samples": 100, "window_bytes": 1 << 20}
                    self._frame(connection, graph | {"request": message["request"]})  # the wrong answer
                    self._frame(connection, answer | limits | {"ring_bytes": 1 << 20})
                    answers += 1
                elif message.get("m") == "observe":
                    self._frame(connection, graph | {"request": message["request"]})
                    answers += 1
        return ids

    def _read_rest(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        try:
            while connection.recv(1 << 20):
                pass
        except BlockingIOError:
            pass

    def _frame(
        self, connection: socket.socket, message: dict[str, Any], fds: list[int] | None = None
    ) -> None:
        body = msgspec.msgpack.encode(message)
        self._send(connection, struct.pack("<IBBH", 4 + len(body), CONTROL, 0, 0) + body, fds)

    def _send(self, connection: socket.socket, raw: bytes, fds: list[int] | None = None) -> None:
        sent = socket.send_fds(connection, [raw], fds or [])
        connection.sendall(raw[sent:])

    # --- nonsense

    def _send_nonsense(self, connection: socket.socket, ids: list[int]) -> None:
        choice = self._source.random()
        if choice < 0.7:
            self._send_message(connection, ids)
        elif choice < 0.93:
            self._send_run(connection, ids)
        elif choice < 0.96:
            kind = self._source.choice([0, 1, 2, 3])
            length = self._source.choice([0, 3, 4, 27, 28, 40, 1 << 31])
            self._send(connection, struct.pack("<IBBH", length, kind, 0, 0) + self._source.randbytes(50))
        else:
            for memory in self._memories[-4:]:
                self._scribble(memory)

    def _send_message(self, connection: socket.socket, ids: list[int]) -> None:
        source = self._source
        tag = source.choice(TAGS)
        qos: dict[str, Any] = {"depth": self._number(ids)}
        for key, value in POLICIES.items():
            if source.random() < 0.4:
                qos[key] = value
        message: dict[str, Any] = {"m": tag, "gid": bytes([source.randrange(3)] * 16), "qos": qos}
        message["route"] = source.choice(["shm", "shm", "socket", "bridge", "road"])
        for field in FIELDS:
            if source.random() < 0.8:
                message[field] = self._value(ids)
        if tag.startswith("graph"):
            self._add_graph(message, ids)
        if tag == "dropped":
            gids = [bytes([source.randrange(5)] * 16) for _ in range(source.randrange(4))]
            message["missed"] = {gid: [self._number(ids), self._value(ids)] for gid in gids}
        for field in ("endpoint", "publisher", "subscription", "other", "source"):
            message[field] = source.choice([*ids, 7, 8])
        fds = self._descriptors(tag)
        if fds or source.random() < 0.2:
            message["descriptors"] = len(fds) if source.random() < 0.9 else source.randrange(4)
        body = msgspec.msgpack.encode(message)
        if source.random() < 0.05:
            body = self._changed(body)
        try:
            self._send(connection, struct.pack("<IBBH", 4 + len(body), CONTROL, 0, 0) + body, fds)
        finally:
            for fd in fds:
                os.close(fd)

    def _add_graph(self, message: dict[str, Any], ids: list[int]) -> None:
        source = self._source
        self._revision += source.choice([1, 1, 1, 0])
        message["revision"] = self._revision
        for field in GRAPH_LISTS:
            if source.random() < 0.6:
                kind = field.partition("_")[0]
                items = [self._record(kind, ids) for _ in range(source.randrange(6))]
                is_removed = field.endswith("removed") and kind != "matches"
                message[field] = [item.get("id", -1) for item in items] if is_removed else items
                if source.random() < 0.03:
                    message[field] = self._value(ids)

    def _record(self, kind: str, ids: list[int]) -> dict[str, Any]:
        source = self._source
        number = source.randrange(2, 8)
        owner = source.randrange(2) if source.random() < 0.99 else number
        text = source.choice(["/a", "/a/_request", "/a/_reply", "/_request", "", "b" * 300, "c\0d"])
        types = {"type_name": source.choice(["a/srv/B_Request", "_Request", ""]), "type_hash": text}
        origin = {"bridge": text, "bus": ""}
        counters = {"dropped": {text: number}, "age_parts": [number] * source.randrange(4), "samples": -1}
        record: dict[str, Any] = {
            "nodes": {"id": number, "name": "n", "namespace": text, "pid": 1, "origin": origin},
            "endpoints": {"id": number, "node": owner, "topic": text, "gid": bytes(16), **types}
            | {"qos": {"deadline": source.choice([1.0, -1.0, 1e300, float("nan"), None])}}
            | {"statistics": source.choice([None, {}, counters])},
            "matches": {"publisher": number, "subscription": source.randrange(2), "route": text},
        }[kind]  # fmt: skip
        record["kind"] = source.choice(["publisher", "publisher", "subscription", "tap", "new"])
        if source.random() < 0.02:
            record[source.choice([*record])] = self._value(ids)
        return record

    def _value(self, ids: list[int]) -> Any:
        source = self._source
        others = [
            None,
            True,
            -1,
            1.5,
            float("nan"),
            "x" * 500,
            b"ab",
            [1, [2]],
            {"replaced": 3, "new": 4},
            {1: 2},
        ]
        return self._number(ids) if source.random() < 0.7 else source.choice(others)

    def _number(self, ids: list[int]) -> int:
        return self._source.choice([*ids, 0, 1, 5, 1000, 1 << 20, 2**31, 2**32, 2**62 - 1, 2**62, 2**64 - 1])

    def _changed(self, body: bytes) -> bytes:
        changed = bytearray(body)
        for _ in range(self._source.randrange(1, 4)):
            changed[self._source.randrange(len(changed))] = self._source.randrange(256)
        return bytes(changed[: self._source.randrange(1, len(changed) + 1)])

    def _send_run(self, connection: socket.socket, ids: list[int]) -> None:
        source = self._source
        count = source.choice([0, 1, 1, 2, 5])
        records = b""
        for _ in range(count):
            payload = source.randbytes(source.randrange(40))
            stamp = source.choice([0, 10**9, -1, 2**63 - 1])
            records += struct.pack("<Iq", len(payload), stamp) + payload
        claimed = count if source.random() < 0.97 else source.choice([count + 1, 2**32 - 1])
        endpoint, other = source.choice([*ids, 9]), source.choice([*ids, 7, 8])
        seq = source.choice([0, 1, 2, 50, 1 << 40, 2**62 - 1, 2**64 - 1])
        head = struct.pack("<IIQII", endpoint, other, seq, claimed, 0)
        frame = struct.pack("<IBBH", 4 + len(head) + len(records), DATA, source.randrange(4), 0)
        self._send(connection, frame + head + records)

    # --- memories

    def _descriptors(self, tag: str) -> list[int]:
        source = self._source
        if source.random() < 0.2:
            return [os.eventfd(0) for _ in range(source.randrange(3))]
        if tag == "matched":
            return [self._ring(), os.eventfd(0, os.EFD_NONBLOCK)]
        if tag == "ring*":
            return [self._ring()]
        return [self._readers(), os.eventfd(0, os.EFD_NONBLOCK)] if tag == "attached" else []

    def _ring(self) -> int:
        first = self._source.choice([0, 1, 1, 100, 2**62 + 5])
        geometry = struct.pack(
            "<QIIQQQQQQ", 0x676E697264737562, 1, RING_HEADER, RING_BYTES, CAPACITY, INDEX, RING_HEADER,
            RING_HEADER + 8 * INDEX, first,
        )  # fmt: skip
        return self._memory(RING_BYTES, geometry)

    def _readers(self) -> int:
        return self._memory(
            READERS_BYTES, struct.pack("<QIIQQ", 0x6461657264737562, 1, 256, READERS_BYTES, 16)
        )

    def _memory(self, size: int, head: bytes) -> int:
        fd = os.memfd_create("hostile", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        os.posix_fallocate(fd, 0, size)
        memory = mmap.mmap(fd, size)
        memory[: len(head)] = head
        for _ in range(self._source.randrange(4)):
            self._scribble(memory)
        if self._source.random() < 0.05:
            memory[: len(head)] = self._changed(head).ljust(len(head), b"\0")
        fcntl.fcntl(fd, 1033, SEALS if self._source.random() < 0.95 else 0)
        self._memories.append(memory)
        return fd

    def _scribble(self, memory: mmap.mmap) -> None:
        """Change some words, behind the geometry: counters, index and heads of records."""
        words = [128, 256, 384, 392, 512, 520, 640, 648, 656, *range(1152, 1152 + 64 * 4, 8), 1152 + 64 * 20]
        for _ in range(self._source.randrange(1, 8)):
            at = self._source.choice(words)
            if at + 8 <= len(memory):
                small = self._source.choice([0, 1, 2, 3, 64, 128, 4096, 2**32 + 40, 2**40, 2**62, 2**64 - 1])
                memory[at : at + 8] = struct.pack("<Q", small)
