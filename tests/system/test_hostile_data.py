"""Wrong data frames, and declarations that break the rules: only the sender suffers, receivers continue."""

import asyncio
from typing import Any

import msgspec
import pytest

import bus
from bus.msg.std_msgs import String
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import MAX_COUNT, RECORD_HEAD
from bus.wire.runs import Run
from conftest import WAIT_S, Daemon
from feeding import frame_record
from neighbours import with_limits
from raw_peer import STRING, RawPeer, control, data, text
from semantics import until

pytestmark = pytest.mark.usefixtures("neighbours")

_I64 = 1 << 63
BROKEN_BODIES = [
    # claimed samples, body, delivered samples, undecodable samples
    (2, text("the only one of two, long enough for the lie to stand a chance"), 1, 1),
    (3, text("a") + RECORD_HEAD.pack(10_000, 1) + b"not so many bytes", 1, 2),
    (1, RECORD_HEAD.pack(0xFFFFFFFF, 1) + b"x", 0, 1),
    (1, text("counted") + text("not counted"), 1, 0),
    (1, frame_record(b"", 1), 0, 1),
    (1, frame_record(b"\xc1", 1), 0, 1),
    (1, frame_record(STRING.encode(String(data="x")) + b"more", 1), 0, 1),
    (1, frame_record(b"\x91" * 100_000 + b"\xc0", 1), 0, 1),
    (1, frame_record(b"\x91\xa4\xff\xfe\xfd\xfc", 1), 0, 1),
    (1, frame_record(msgspec.msgpack.encode([7]), 1), 0, 1),
    (1, RECORD_HEAD.pack(len(p := STRING.encode(String(data="old"))), -_I64) + p, 1, 0),
    (1, RECORD_HEAD.pack(len(p), _I64 - 1) + p, 1, 0),
]


class TestBodies:
    @pytest.mark.parametrize("depth", [100, 0], ids=["keep last", "keep all"])
    async def test_what_does_not_decode_is_counted_and_the_stream_goes_on(
        self, peer: RawPeer, depth: int
    ) -> None:
        qos = bus.QoSProfile(depth) if depth else bus.QoSProfile(history="keep_all")
        async with asyncio.timeout(WAIT_S), bus.Node("victim", arguments=[], rosout=False) as node:
            subscription = await node.create_subscription(String, "/t", qos)
            publisher = peer.hello().publisher(peer.node(), "/t", qos=qos).id
            seq, bad = 1, 0
            for count, body, delivered, undecodable in BROKEN_BODIES:
                peer.write(data(publisher, body, first_seq=seq, count=count))
                peer.write(data(publisher, text(f"sound {seq}"), first_seq=seq + count))
                for _ in range(delivered):
                    await subscription.receive()
                message, info = await subscription.receive()
                assert (message.data, info.publication_sequence_number) == (f"sound {seq}", seq + count)
                seq += count + 1
                bad += undecodable
                assert subscription.statistics().dropped == ({"undecodable": bad} if bad else {})
            assert subscription.statistics().publishers == 1

    async def test_a_callback_goes_on_too(self, peer: RawPeer) -> None:
        heard: list[str] = []
        async with asyncio.timeout(WAIT_S), bus.Node("victim", arguments=[], rosout=False) as node:
            await node.create_subscription(String, "/t", 100, lambda message: heard.append(message.data))
            publisher = peer.hello().publisher(peer.node(), "/t").id
            peer.write(data(publisher, RECORD_HEAD.pack(99, 1) + b"\xc1" * 20))
            peer.write(data(publisher, text("sound"), first_seq=2))
            await until(lambda: heard)
        assert heard == ["sound"]

    def test_more_samples_than_bytes(self, peer: RawPeer, other: RawPeer) -> None:
        subscription = other.subscription(other.node(), "/t").id
        publisher = peer.hello().publisher(peer.node(), "/t").id
        peer.write(data(publisher, text("x"), count=0xFFFFFFFF))
        assert "claims 4294967295 samples" in peer.fault()
        graph: m.GraphSnapshot = other.ask(m.GetGraph(request=other.request(), statistics=True))
        (mine,) = (one for one in graph.endpoints if one.id == subscription)
        assert mine.statistics == m.EndpointStatistics()

    @with_limits(message_bytes=1 << 20)
    def test_more_than_fits_into_a_message(self, peer: RawPeer, other: RawPeer) -> None:
        """The limit applies to each sample, because a frame may carry small messages before a large one."""
        other.subscription(other.node(), "/t")
        publisher = peer.hello().publisher(peer.node(), "/t").id
        peer.write(data(publisher, frame_record(bytes((1 << 20) + 1), 1)))
        peer.write(data(publisher, text("small"), first_seq=2))
        heard: dict[type, Any] = {}  # in either order: busd reports drops a little later
        while not {Run, m.Dropped} <= heard.keys():
            item = other.receive()
            assert item is not None
            heard[type(item)] = item
        assert heard[Run].first_seq == 2
        assert heard[m.Dropped].dropped == {"too_large": 1}
        peer.write(data(publisher, bytes(2 << 20), first_seq=3))
        assert peer.fault().startswith(f"frame of {(2 << 20) + 28} bytes")


class TestNumbers:
    @pytest.mark.parametrize("again", [1, 2, 3])
    def test_going_back_or_repeating(self, peer: RawPeer, again: int) -> None:
        publisher = peer.hello().publisher(peer.node(), "/t").id
        peer.write(data(publisher, text("a") + text("b") + text("c"), count=3))
        peer.write(data(publisher, text("again"), first_seq=again))
        assert peer.fault() == f"publisher {publisher} sent sample {again} after 3"

    def test_gaps_are_counted_and_their_sum_is_bounded(self, daemon: Daemon, other: RawPeer) -> None:
        subscription = other.subscription(other.node(), "/t").id
        for _ in range(5):
            with RawPeer(daemon.path) as peer:
                publisher = peer.hello().publisher(peer.node(), "/t").id
                peer.write(data(publisher, text("far"), first_seq=MAX_COUNT))
                assert other.expect(Run).first_seq == MAX_COUNT
                peer.write(data(publisher, text("further"), first_seq=MAX_COUNT))
                assert peer.fault()
        graph: m.GraphSnapshot = other.ask(m.GetGraph(request=other.request(), statistics=True))
        (mine,) = (one.statistics for one in graph.endpoints if one.id == subscription)
        assert mine is not None
        assert mine.dropped == {"publisher_queue": MAX_COUNT}

    def test_reports_that_boast(self, daemon: Daemon, peer: RawPeer, other: RawPeer) -> None:
        node = peer.hello().node("boaster")
        publisher = peer.publisher(node, "/t").id
        subscription = peer.subscription(node, "/t").id
        for endpoint in (publisher, subscription):
            most = dict.fromkeys(("replaced", "publisher_queue"), MAX_COUNT)
            peer.send(m.Report(endpoint, samples=MAX_COUNT, bytes=MAX_COUNT, queued=MAX_COUNT, dropped=most))
        peer.write(data(publisher, text("x"), first_seq=MAX_COUNT))
        peer.barrier()
        graph: m.GraphSnapshot = other.ask(m.GetGraph(request=other.request(), statistics=True))
        assert {one.id for one in graph.endpoints} >= {publisher, subscription}
        for lie in ({"samples": -1}, {"samples": MAX_COUNT + 1}, {"dropped": {"x" * 33: 1}}, {"queued": -1}):
            fields = {"m": "report", "endpoint": publisher, "samples": 0, "bytes": 0, **lie}
            with RawPeer(daemon.path) as liar:
                liar.hello().write(control(msgspec.msgpack.encode(fields)))
                assert "control message not understood" in liar.fault()


class TestDeclarations:
    def test_names(self, peer: RawPeer) -> None:
        node = peer.hello().node("sound")
        for name, namespace in [
            ("", "/"),
            ("with space", "/"),
            ("9lives", "/"),
            ("a/b", "/"),
            ("ünïcode", "/"),
            ("x" * 256, "/"),
            ("x\n", "/"),
            ("x", "relative"),
            ("x", "/a//b"),
            ("x", "/9"),
            ("x", ""),
        ]:
            answer = peer.ask(m.CreateNode(request=peer.request(), name=name, namespace=namespace))
            assert isinstance(answer, m.Refused), (name, namespace)
        for topic in [
            "",
            "/",
            "relative",
            "/a//b",
            "/a/",
            "/9",
            "/~",
            "/a b",
            "/{node}",
            "/x\n",
            "/" + "x" * 300,
        ]:
            for declare in (peer.publisher, peer.subscription):
                assert isinstance(declare(node, topic), m.Refused), topic
        assert isinstance(peer.publisher(node, "/sound"), m.Created)

    def test_what_no_client_of_ours_would_send(self, daemon: Daemon) -> None:
        sound = msgspec.to_builtins(
            m.CreatePublisher(1, 0, "/t", STRING.name, STRING.hash, QoSProfile(), bytes(16)),
            builtin_types=(bytes,),
        )
        for wrong, reason in [
            ({"gid": b"short"}, "gid of 5 bytes"),
            ({"gid": bytes(100_000)}, "gid of 100000 bytes"),
            ({"type_name": "other/msg/Type"}, "was not declared on this connection"),
            ({"next_seq": 0}, "control message not understood"),
            ({"next_seq": MAX_COUNT + 1}, "control message not understood"),
            ({"request": "one"}, "control message not understood"),
            ({"topic": 7}, "control message not understood"),
            ({"qos": {"depth": 0}}, "control message not understood"),
            ({"qos": {"depth": -5}}, "control message not understood"),
            ({"qos": {"depth": (1 << 64) - 1}}, "control message not understood"),
            ({"qos": {"history": "keep_nothing"}}, "control message not understood"),
            ({"qos": {"deadline": float("nan")}}, "control message not understood"),
            ({"qos": {"lifespan": -1.0}}, "control message not understood"),
            ({"qos": {"lifespan": 1e300}}, "control message not understood"),
            ({"qos": {"liveliness_lease_duration": 0.0}}, "control message not understood"),
        ]:
            with RawPeer(daemon.path) as peer:
                node = peer.hello().node()
                peer.write(control(msgspec.msgpack.encode({**sound, "node": node, **wrong})))  # type: ignore[dict-item]
                assert reason in peer.fault(), wrong

    def test_a_depth_above_the_limit(self, peer: RawPeer) -> None:
        node = peer.hello().node()
        answer = peer.publisher(node, "/t", qos=QoSProfile(depth=1_000_000))
        assert answer.text == "depth 1000000 is more than busd's limit of 100000"

    def test_the_shortest_leases_and_lifespans(self, peer: RawPeer, other: RawPeer) -> None:
        """One nanosecond for each: every sample expires, and busd does not spin."""
        shortest: dict[str, Any] = {"liveliness_lease_duration": 1e-9, "lifespan": 1e-9, "deadline": 1e-9}
        node = peer.hello().node()
        publishers = [peer.publisher(node, "/t", qos=QoSProfile(**shortest)).id for _ in range(50)]
        other.subscription(other.node(), "/t", qos=QoSProfile(liveliness_lease_duration=1.0))
        for seq in range(1, 20):
            for publisher in publishers:
                peer.write(data(publisher, text("x"), first_seq=seq))
        peer.barrier()
        other.barrier()

    def test_gone_things_are_gone(self, peer: RawPeer) -> None:
        node = peer.hello().node()
        publisher = peer.publisher(node, "/t").id
        peer.send(m.DestroyNode(node=node))
        peer.write(data(publisher, text("late")))
        assert "not one of yours" in peer.fault()

    def test_a_schema_that_nobody_has(self, peer: RawPeer) -> None:
        peer.hello()
        answer = peer.ask(m.GetType(request=1, type_name="x" * 1000, type_hash="\n"))
        assert isinstance(answer, m.Refused)
        peer.barrier()

    async def test_a_broken_schema_is_an_error_of_who_asks(self, peer: RawPeer) -> None:
        peer.hello().send(
            *(
                m.DeclareType(f"bad/msg/T{number}", "hash", (schema))
                for number, schema in enumerate(BROKEN_SCHEMAS)
            )
        )
        peer.barrier()
        async with asyncio.timeout(WAIT_S), bus.Node("curious", arguments=[], rosout=False) as node:
            for number in range(len(BROKEN_SCHEMAS)):
                with pytest.raises(bus.ConfigurationError):
                    await node.get_type(f"bad/msg/T{number}", "hash")

    async def test_a_broken_schema_of_a_type_of_one_name_is_told_by_its_hash(self, peer: RawPeer) -> None:
        told: list[bus.IncompatibleType] = []
        events = bus.PublisherEvents(incompatible_type=told.append)
        node = peer.hello().node("liar")
        schemas = {f"hash-{number}": schema for number, schema in enumerate(BROKEN_SCHEMAS)}
        for type_hash, schema in schemas.items():
            peer.send(m.DeclareType(STRING.name, type_hash, schema))
            peer.subscription(node, "/t", type_hash=type_hash)
        async with asyncio.timeout(WAIT_S), bus.Node("victim", arguments=[], rosout=False) as victim:
            publisher = await victim.create_publisher(String, "/t", events=events)
            await until(lambda: len(told) == len(schemas))
            assert publisher._core.id
        assert {event.node for event in told} == {"/liar"}
        assert all(event.text.startswith(f"both call it {STRING.name}, but ") for event in told)
        assert sum("their definitions differ" in event.text for event in told) >= 3

    @pytest.mark.parametrize("depth", [960, 50_000])
    async def test_a_schema_that_nests_too_deep(self, peer: RawPeer, depth: int) -> None:
        """busd passes it on unchanged. A client that asks for it gets an error, and keeps its connection."""
        peer.hello().send(m.DeclareType("bad/msg/T", "hash", b"\x91" * depth + b"\xc0"))
        peer.barrier()
        async with asyncio.timeout(WAIT_S), bus.Node("curious", arguments=[], rosout=False) as node:
            publisher = await node.create_publisher(String, "/t")
            asking = asyncio.ensure_future(node.get_type("bad/msg/T", "hash"))
            await until(lambda: asking.done() or not publisher._core.id)
            assert publisher._core.id, "the answer cost the connection"
            with pytest.raises(bus.ConfigurationError):
                await asking


BROKEN_SCHEMAS = [
    b"\xc0",
    b"\x07",
    b"\x90",
    b"\x80",
    b"\x91" * 500 + b"\xc0",
    msgspec.msgpack.encode({"root": "nowhere", "types": {}}),
    msgspec.msgpack.encode({"root": ["list"], "types": []}),
]
