"""Bounds on the calls of Python for a packed message that crosses a bridge. See `callcount`."""

from collections.abc import Callable
from typing import Any

from bus import shm
from bus.endpoint.matches import Match
from bus.msg.std_msgs import String
from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus_bridge.core.export import Export
from bus_bridge.core.imports import Import
from bus_bridge.core.lateness import Lateness
from bus_bridge.engine import FarEndpoint, LocalEndpoint, LocalNode, RouteRule
from bus_bridge.packed import RECORD, Packed
from bus_bridge.zenoh import records
from bus_bridge.zenoh.presence import Interest
from bus_bridge.zenoh.reading import ZenohReader
from bus_bridge.zenoh.writing import ZenohWriter
from callcount import CallCounter

GID, QOS, SCHEMA = bytes(16), QoSProfile(10), MessageSchema.of(String)
OUT, IN = 12, 12 if shm.has_core() else 14


def packed(number: int) -> bytes:
    return RECORD.pack(number, number, 2) + b"\x91\xa0"


class Session:
    """A session of both engines. It keeps all puts."""

    def __init__(self) -> None:
        self.puts: list[tuple[bytes, bytes]] = []
        self.put: Any = lambda payload, attachment: self.puts.append((payload, attachment))
        self.take: Callable[[tuple[bytes, bytes | None]], None] = print
        self.give: Callable[[], None] = print

    def outlet(self, *_: object) -> "Session":
        return self

    def source(self, take: Any, *_: object, after: Any, **__: object) -> "Session":
        self.take, self.give = take, after
        return self

    def subscribe(self, *_: object) -> None: ...
    def token(self, *_: object) -> None: ...
    def push(self, *_: object) -> None: ...

    def ask(self, key: str, payload: bytes, timeout_s: float, on_answer: Any) -> None:
        on_answer(b"", records.write_pair(0, 0))  # no message is kept, and the route begins here


class Publisher:
    def __init__(self) -> None:
        self.matches = (Match("/listener", b"listener" * 2, QOS, "shm"),)
        self.published = 0

    def publish_packed(self, data: bytes, start: int) -> int:
        self.published += 1
        return 1


async def test_a_message_that_goes_out_and_comes_in() -> None:
    session: Any = Session()
    local = LocalEndpoint(
        "publisher", GID, LocalNode(1, "talker", "/"), "/t", SCHEMA.type_name, SCHEMA.type_hash, QOS
    )
    writer = ZenohWriter(session, "here", local, RouteRule(), lambda: None, lambda: None)
    writer.see_interests(frozenset((Interest("far", "run"),)))
    export = Export(GID, 10, lambda gid: True, lambda gid: None)
    export.attach(writer, QOS, RouteRule())
    for number in (1, 2):
        batch = Packed.read(packed(number), 1 << 40)
        assert batch is not None
        with CallCounter() as out:
            export.put(batch)
    assert export.account.sent == len(session.puts) == 2

    class Engine:
        def read(
            self, endpoint: FarEndpoint, schema: object, on_batch: Any, *, restores: bool
        ) -> ZenohReader:
            own, room = Interest("far", "run"), records.Room(1 << 20)
            return ZenohReader(session, own, "here", endpoint, room, on_batch, print, lambda: None)

    far = FarEndpoint("publisher", GID, "here/1", "/t", SCHEMA.type_name, SCHEMA.type_hash, QOS)
    engine: Any = Engine()
    publisher: Any = Publisher()
    way = Import(engine, far, SCHEMA, publisher, Lateness(), print)
    way.on_matched()
    for put in session.puts:
        with CallCounter() as came:
            session.take(put)
            session.give()
    assert way.account.sent == publisher.published == 2 and way.losses == {}
    assert out.python <= OUT, out.calls
    assert came.python <= IN, came.calls
