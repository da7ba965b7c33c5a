"""A client of Foxglove's protocol for tests, like a viewer."""

import json
import shutil
import struct
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from conftest import WAIT_S
from vendoring import FOXGLOVE
from web_clients import Serving

SDK, OLDER = "foxglove.sdk.v1", "foxglove.websocket.v1"

Frame = dict[str, Any] | bytes

NPM_CLIENT = """
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const WebSocket = require("ws");
const [address, ...words] = process.argv.slice(1);
const socket = new WebSocket(address, [FoxgloveClient.SUPPORTED_SUBPROTOCOL]);
const client = new FoxgloveClient({ ws: socket });
client.on("error", (error) => { console.error(String(error)); process.exit(1); });
"""
NPM_TOPICS = """
const missing = new Set(words), byNumber = new Map();
client.on("advertise", (channels) => {
  for (const one of channels) if (missing.has(one.topic)) byNumber.set(client.subscribe(one.id), one);
});
client.on("message", ({ subscriptionId, data }) => {
  const one = byNumber.get(subscriptionId);
  if (missing.delete(one.topic)) console.log(`${one.topic} ${one.schemaName} ${data.byteLength}`);
  if (missing.size === 0) process.exit(0);
});
"""
"""Takes a message of each topic, and prints its topic, type and size."""


class Foxglove:
    """A client; it keeps announced channels and services until a test asks for them."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.channels: dict[str, dict[str, Any]] = {}
        self.services: dict[str, dict[str, Any]] = {}
        self.heard: list[Frame] = []

    def say(self, op: str, **fields: Any) -> None:
        self.connection.send(json.dumps({"op": op, **fields}))

    def listen(self, patience_s: float = WAIT_S) -> Frame:
        """The next frame; channels and services are noted. Raises TimeoutError."""
        frame = self.connection.recv(max(0.0, patience_s))
        if isinstance(frame, bytes):
            return frame
        told: dict[str, Any] = json.loads(frame)
        for one in told.get("channels", ()):
            self.channels[one["topic"]] = one
        for one in told.get("services", ()):
            self.services[one["name"]] = one
        if told["op"] == "unadvertise":
            self.channels = {
                topic: one for topic, one in self.channels.items() if one["id"] not in told["channelIds"]
            }
        return told

    def hear(self, op: str, fits: Callable[[Any], object] = lambda told: True) -> Any:
        """The next fitting text of that kind; earlier ones are skipped. Raises TimeoutError."""
        end = time.monotonic() + WAIT_S
        while True:
            told = self.listen(end - time.monotonic())
            if isinstance(told, dict) and told["op"] == op and fits(told):
                return told

    def channel(self, topic: str) -> dict[str, Any]:
        """The channel of a topic; waits for it."""
        while topic not in self.channels:
            self.listen()
        return self.channels[topic]

    def service(self, name: str) -> dict[str, Any]:
        """The service of that name; waits for it."""
        while name not in self.services:
            self.listen()
        return self.services[name]

    def subscribe(self, numbers: Mapping[int, str]) -> None:
        """Subscribe to topics, by the numbers of the subscriptions."""
        wanted = [{"id": number, "channelId": self.channel(topic)["id"]} for number, topic in numbers.items()]
        self.say("subscribe", subscriptions=wanted)

    def binary(self, kind: int) -> bytes:
        """The next binary frame of that kind, without the first byte."""
        while True:
            told = self.listen()
            if isinstance(told, bytes) and told[0] == kind:
                return told[1:]

    def message(self, number: int | None = None) -> tuple[int, int, bytes]:
        """The next message, of that subscription: its number, time, data."""
        while True:
            data = self.binary(1)
            found, time_ns = struct.unpack_from("<IQ", data)
            if number in (None, found):
                return found, time_ns, data[12:]


@contextmanager
def looking(server: Serving, subprotocol: str = SDK, **more: Any) -> Iterator[Foxglove]:
    """Connect to the printed address."""
    with connect(
        server.foxglove,
        subprotocols=[Subprotocol(subprotocol)],
        max_size=None,
        max_queue=None,  # otherwise a full queue delays the answer to our close by ten seconds
        proxy=None,
        **more,
    ) as connection:
        assert connection.subprotocol == subprotocol
        yield Foxglove(connection)


def npm_client(server: Serving, program: str, *words: str) -> list[str]:
    """The lines that a program with Foxglove's published client (`client`) prints about `words`."""
    if shutil.which("node") is None:
        pytest.skip("no node, which runs that client")
    if not (FOXGLOVE / "node_modules" / "ws").exists():
        pytest.skip("no @foxglove/ws-protocol: `make foxglove` fetches it by npm")
    result = subprocess.run(
        ["node", "-e", NPM_CLIENT + program, server.foxglove, *words],
        cwd=FOXGLOVE,
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert (result.returncode, result.stderr) == (0, "")
    return result.stdout.splitlines()
