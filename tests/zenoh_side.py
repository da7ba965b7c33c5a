"""One side of a link between two engines for zenoh, as a program: a publisher, or its reader.

    zenoh_side.py publish BUS ADDRESS QOS SIZE RATE_HZ      listens at ADDRESS
    zenoh_side.py read BUS ADDRESS                          connects to it

QOS is as in tokens (`rk10v`). RATE_HZ 0 is as fast as the writer takes. It answers each line on standard
input by a line of JSON: its state. It ends with the input.
"""

import asyncio
import json
import resource
import sys
import time
from collections import deque
from pathlib import Path

from bus.msg.std_msgs import String
from bus.schema import MessageSchema
from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.engine import FarBus, FarEndpoint, FarNode, LocalEndpoint, LocalNode, RouteRule
from bus_bridge.zenoh import qos_text
from bus_bridge.zenoh.engine import ZenohEngine
from bus_bridge.zenoh.options import ZenohOptions
from bus_bridge.zenoh.reading import ZenohReader

SCHEMA = MessageSchema.of(String)
GID = bytes(range(16))
DEPTH = 1000


class Publishing:
    """Sends queued messages when it can; if there are too many, it drops the oldest."""

    def __init__(self, engine: ZenohEngine, qos: str, size: int, rate_hz: float) -> None:
        profile = qos_text.read(qos)
        assert profile is not None
        node = LocalNode(1, "talker", "/")
        endpoint = LocalEndpoint(
            "publisher", GID, node, "/chatter", SCHEMA.type_name, SCHEMA.type_hash, profile
        )
        engine.announce_node(node)
        self.sent = self.replaced = self.number = 0
        self.slowest_s = 0.0
        self.change = asyncio.Event()
        self.writer = engine.announce_publisher(endpoint, SCHEMA, RouteRule(), self.change.set)
        self._waiting: deque[Sample] = deque()
        self._payload = bytes(size)
        self._rate_hz = rate_hz
        self._is_lossless = profile.is_lossless

    async def run(self) -> None:
        while not self.writer.is_wanted:
            self.change.clear()
            await self.change.wait()
        begin = time.monotonic()
        while True:
            if self._rate_hz:
                due = int((time.monotonic() - begin) * self._rate_hz) - self.number
            else:
                due = DEPTH - len(self._waiting)
            for _ in range(due):
                if self._is_lossless and len(self._waiting) >= DEPTH:
                    break
                self.number += 1
                self._waiting.append(Sample(self._payload, self.number, time.time_ns()))
            while len(self._waiting) > DEPTH:
                self._waiting.popleft()
                self.replaced += 1
            self.change.clear()
            before = time.perf_counter()
            gone = 0
            if self._waiting and self.writer.is_wanted:
                gone = self.writer.write(Loose(list(self._waiting)))
            self.slowest_s = max(self.slowest_s, time.perf_counter() - before)
            self.sent += gone
            for _ in range(gone):
                self._waiting.popleft()
            if self._rate_hz:
                await asyncio.sleep(1 / self._rate_hz)
            elif gone:
                await asyncio.sleep(0)
            else:
                await self.change.wait()

    def tell(self) -> dict[str, object]:
        return {
            "sent": self.sent,
            "replaced": self.replaced,
            "is_wanted": self.writer.is_wanted,
            "slowest_s": self.slowest_s,
        }


class Reading:
    """A FarSide that reads every new publisher."""

    def __init__(self) -> None:
        self.engine: ZenohEngine | None = None
        self.readers: dict[bytes, ZenohReader] = {}
        self.buses: list[str] = []
        self.warnings: list[str] = []
        self.count = self.first = self.last = self.missing = self.repeated = 0
        self.arrived_at = self.longest_gap_s = 0.0

    def bus_added(self, bus: FarBus) -> None:
        self.buses.append(bus.id)

    def bus_removed(self, bus_id: str, reason: str) -> None:
        self.buses.remove(bus_id)
        for reader in self.readers.values():
            reader.close()
        self.readers.clear()

    def node_added(self, node: FarNode) -> None: ...
    def node_removed(self, key: str) -> None: ...

    def endpoint_added(self, endpoint: FarEndpoint) -> None:
        if self.engine is not None:
            self.readers[endpoint.gid] = self.engine.read(
                endpoint, SCHEMA, lambda samples: self.take(endpoint.gid, samples)
            )

    def endpoint_removed(self, gid: bytes, node: str) -> None:
        if gid in self.readers:
            self.readers.pop(gid).close()

    def warn(self, text: str) -> None:
        if text not in self.warnings:
            self.warnings.append(text)

    def take(self, gid: bytes, batch: Batch) -> None:
        now = time.monotonic()
        if self.arrived_at:
            self.longest_gap_s = max(self.longest_gap_s, now - self.arrived_at)
        self.arrived_at = now
        for sample in batch:
            if not self.count:
                self.first = sample.number
            elif sample.number <= self.last:
                self.repeated += 1
            else:
                self.missing += sample.number - self.last - 1
            self.last = max(self.last, sample.number)
            self.count += 1
        if gid in self.readers:
            self.readers[gid].taken(batch.payload_bytes)

    def tell(self) -> dict[str, object]:
        names = ("buses", "count", "first", "last", "missing", "repeated", "longest_gap_s", "warnings")
        return {name: getattr(self, name) for name in names}


async def main(role: str, bus: str, address: str, *rest: str) -> None:
    reading = Reading()
    addresses = (address,)
    if role == "publish":
        engine = ZenohEngine(bus, ZenohOptions(listen=addresses, insecure=True))
        await engine.open(reading)
        publishing = Publishing(engine, rest[0], int(rest[1]), float(rest[2]))
        task = asyncio.create_task(publishing.run())
    else:
        engine = reading.engine = ZenohEngine(bus, ZenohOptions(connect=addresses, insecure=True))
        await engine.open(reading)
    lines = asyncio.StreamReader()
    loop = asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(lines), sys.stdin)
    while await lines.readline():
        told = reading.tell() | (publishing.tell() if role == "publish" else {})
        told["memory"] = _memory()
        print(json.dumps(told), flush=True)
    if role == "publish":
        task.cancel()
    await engine.close()


def _memory() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
