"""`bus web` as tests run it, and its clients: HTTP, WebSockets, a client that stops reading."""

import base64
import json
import os
import re
import socket
import struct
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from cli import Running, start
from conftest import WAIT_S

PAGE = "busd.page.v1"

CAMERA = """
import asyncio, sys, bus
from bus.msg.sensor_msgs import CompressedImage
HEAD = bytes([255, 216, 255, 192, 0, 17, 8, 1, 0, 1, 0])
async def main():
    async with bus.Node("camera") as node:
        publisher = await node.create_publisher(CompressedImage, "image", 1)
        image = CompressedImage(format="jpeg", data=HEAD + bytes(500_000))
        print("ready", flush=True)
        while True:
            publisher.publish(image)
            await asyncio.sleep(float(sys.argv[1]))
bus.run(main())
"""
LOSER = """
import asyncio, bus
from bus.msg.std_msgs import String
async def main():
    async with bus.Node("loser") as node:
        subscription = await node.create_subscription(String, "topic", 2)
        print("ready", flush=True)
        while True:
            await subscription.receive()
            await asyncio.sleep(0.2)
bus.run(main())
"""
"""It takes five messages a second, and two may wait."""


class Serving:
    """A running `bus web`."""

    def __init__(self, running: Running, page: str, foxglove: str) -> None:
        self.running = running
        self.page = page
        self.foxglove = foxglove
        parts = urlsplit(page)
        assert parts.hostname is not None
        assert parts.port is not None
        self.host, self.port = parts.hostname, parts.port
        self.token = parts.query.removeprefix("token=")

    def get(self, target: str, headers: Mapping[str, str] | None = None, method: str = "GET") -> HTTPResponse:
        """An answer with its body already read."""
        connection = HTTPConnection(self.host, self.port, timeout=WAIT_S)
        try:
            connection.request(method, target, headers=dict(headers or {}))
            answer = connection.getresponse()
            answer.text = answer.read().decode()  # type: ignore[attr-defined]
            return answer
        finally:
            connection.close()

    def cookie(self) -> str:
        """The cookie that a browser sends after a visit to the address with the token."""
        given = self.get(f"/?token={self.token}").headers["Set-Cookie"]
        return str(given).partition(";")[0]

    @contextmanager
    def viewer(self, **more: Any) -> Iterator["Viewer"]:
        """An open page."""
        address = f"ws://{self.host}:{self.port}/"
        headers = {"Cookie": self.cookie()}
        with connect(
            address,
            subprotocols=[Subprotocol(PAGE)],
            additional_headers=headers,
            max_size=None,
            max_queue=None,  # otherwise a full queue delays the answer to our close by ten seconds
            proxy=None,
            **more,
        ) as connection:
            yield Viewer(connection)


class Viewer:
    """The messages that a page sends and receives."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection

    def say(self, op: str, **fields: Any) -> None:
        self.connection.send(json.dumps({"op": op, **fields}))

    def hear(self, op: str, fits: Callable[[Any], object] = lambda told: True) -> Any:
        """The next fitting message of that kind. Raises TimeoutError."""
        end = time.monotonic() + WAIT_S
        while True:
            told = json.loads(self.connection.recv(max(0.0, end - time.monotonic())))
            if told["op"] == op and fits(told):
                return told


@contextmanager
def serving(*words: str, is_fresh: bool = False) -> Iterator[Serving]:
    """Start it on a free port."""
    given = words if "--listen" in words else ("--listen", "127.0.0.1:0", *words)
    with start("web", *given, is_fresh=is_fresh) as running:
        addresses = dict(running.line().split(": ", 1) for _ in range(2))
        yield Serving(running, addresses["page"], addresses["foxglove"])


class Silent:
    """A client that requests a WebSocket and then reads nothing."""

    def __init__(self, serving: Serving, subprotocol: str = PAGE) -> None:
        self._socket = socket.socket()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self._socket.settimeout(WAIT_S)
        self._socket.connect((serving.host, serving.port))
        key = base64.b64encode(os.urandom(16)).decode()
        lines = (
            f"GET /?token={serving.token} HTTP/1.1",
            f"Host: {serving.host}:{serving.port}",
            "Upgrade: websocket",
            "Connection: Upgrade",
            f"Sec-WebSocket-Key: {key}",
            "Sec-WebSocket-Version: 13",
            f"Sec-WebSocket-Protocol: {subprotocol}",
        )
        self._socket.sendall("\r\n".join((*lines, "", "")).encode())
        assert self._socket.recv(12) == b"HTTP/1.1 101"

    def say(self, op: str, **fields: Any) -> None:
        data = json.dumps({"op": op, **fields}).encode()
        assert len(data) < 126
        self.send(struct.pack("!BBI", 0x81, 0x80 | len(data), 0) + data)  # masked with zeros

    def send(self, octets: bytes) -> None:
        """Send bytes of frames, valid or not."""
        self._socket.sendall(octets)

    def hear_of_missed(self, least: int) -> None:
        """Read now, until a report that so many messages were left out for it."""
        data, missed = b"", 0
        while missed < least:
            part = self._socket.recv(1 << 20)
            assert part, f"it was cut off, and has heard of {missed}"
            data += part
            while (found := re.search(rb'"op":"status","dropped":({[^}]*})', data)) is not None:
                missed += sum(json.loads(found[1]).values())
                data = data[found.end() :]
            data = data[-4096:]

    def wait_for(self, pattern: bytes) -> None:
        """Read now, until a text like that."""
        data = b""
        while not re.search(pattern, data):
            part = self._socket.recv(1 << 20)
            assert part, "it was cut off"
            data = data[-4096:] + part

    def close(self) -> None:
        self._socket.close()


def own_bytes(pid: int) -> int:
    """Memory of a process, without other processes' rings that it has mapped."""
    found = re.search(r"RssAnon:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
    assert found is not None
    return int(found[1]) * 1024
