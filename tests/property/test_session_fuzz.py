"""A mob of processes that send random messages to a broker through the real wire, next to a normal pair.

For any messages of the mob: the broker raises nothing, everything it sends can be decoded, and the pair
receives all its messages. After the mob has left, no trace of it is left.
"""

from contextlib import suppress
from typing import Any, NamedTuple, TypeAlias

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st

from broker_world import ALL_MAY, NUMBER, TEXT, Handle, World
from bus.errors import RemoteProtocolError
from bus.qos import History, QoSProfile
from bus.wire import messages as m
from bus.wire.framing import BUFFER_BYTES, FrameReader
from bus.wire.layout import (
    CONTROL,
    DATA,
    DATA_HEAD,
    DATA_HEAD_BYTES,
    FRAME_HEAD,
    FRAME_HEAD_BYTES,
    LENGTH_BYTES,
    MAX_COUNT,
)
from busd.core.limits import Limits
from effort import examples
from feeding import feed, frame_record

KIB = 1024
LIMITS = Limits(
    nodes_per_peer=3,
    endpoints_per_peer=6,
    matches_per_peer=40,
    topics=6,
    schema_bytes=KIB,
    message_bytes=2 * KIB,
    keep_all_window_bytes=4 * KIB,
    keep_all_window_messages=16,
    queued_bytes_per_peer=8 * KIB,
    history_bytes_per_peer=4 * KIB,
    depth=50,
    lease_s=20.0,
)
STRANGER = 4711

Step: TypeAlias = tuple[Any, ...]


class Mine(NamedTuple):
    """An id that the process was given for a node, publisher or subscription, resolved when it is used."""

    kind: str
    index: int  # type: ignore[assignment]


def mostly(usual: list[Any], *odd: Any) -> st.SearchStrategy[Any]:
    """Usual values, which get far into the broker, and rarely odd ones."""
    return st.sampled_from(usual * (1 + 6 * len(odd) // len(usual)) + list(odd))


def _ids(*kinds: str) -> st.SearchStrategy[Any]:
    mine = [Mine(kind, index) for index in range(4) for kind in kinds]
    return mostly(3 * mine, 0, 1, 2, 3, 999, -1, 1 << 32, 1 << 63, *(Mine(kind, 0) for kind in ENTITIES))


ENTITIES = ("node+", "pub+", "sub+")
nodes, publishers, subscriptions = map(_ids, ENTITIES)
endpoints = _ids("pub+", "sub+")
requests = mostly([1], -1, 1 << 63)
names = mostly(["x", "twin"], "", "9", "a b", "x" * 300, "\n", "ü")
topics = mostly(["/good", "/good", "/a", "/b", "/c/d"], "relative", "/", "/a//b", "/\n", "")
types = mostly([TEXT, TEXT, NUMBER], ("nobody/msg/Knows", "it"), ("", ""), ("x" * 300, "h"))
seconds = mostly([None, 0.5, 1e-9, 100.0], -1.0, 0, float("inf"))
profiles = st.fixed_dictionaries(
    {},
    optional={
        "depth": mostly([1, 2, 50], 51, 0, -1, 1 << 40),
        "history": mostly(["keep_last", "keep_all"], "keep_none"),
        "reliability": mostly(["reliable", "best_effort"], ""),
        "durability": st.sampled_from(["volatile", "transient_local"]),
        "liveliness": st.sampled_from(["automatic", "manual_by_topic"]),
        "deadline": seconds,
        "lifespan": seconds,
        "liveliness_lease_duration": seconds,
    },
)
gids = mostly([number.to_bytes(16, "big") for number in range(1, 5)], b"", b"short", bytes(17))
seqs = mostly([1, 2, 3], 0, -1, MAX_COUNT, MAX_COUNT + 1)
counts = mostly([0, 5], MAX_COUNT, -1, 1 << 62)
drops = st.dictionaries(mostly(["replaced", "made up"], "x" * 40), counts, max_size=2)
no_or_one, no_or_two = mostly([0, 1], 3, -1), mostly([0, 2], 3, -1)
schemas = mostly([b"\xc0", bytes(500)], b"", b"\x91" * 400 + b"\xc0", bytes(2 * KIB))


def _message(tag: str, **fields: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.fixed_dictionaries({"m": st.just(tag), **fields})


def _endpoint(tag: str, **fields: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    kind = types.map(lambda kind: {"type_name": kind[0], "type_hash": kind[1]})
    rest = _message(tag, request=requests, node=nodes, topic=topics, qos=profiles, gid=gids, **fields)
    return st.tuples(rest, kind).map(lambda both: both[0] | both[1])


messages = st.one_of(
    _endpoint("pub+", next_seq=seqs, descriptors=no_or_one),
    _endpoint("pub+"),
    _endpoint("pub+"),
    _endpoint("sub+", last_seqs=st.dictionaries(gids, seqs, max_size=2)),
    _endpoint("sub+"),
    _endpoint("sub+"),
    _message("share", descriptors=no_or_two),
    _message("attach", subscription=subscriptions, source=publishers, slot=mostly([0, 1019], 1 << 16, -1)),
    _message("noshm", endpoint=endpoints, other=endpoints, text=names),
    _message("ring", publisher=publishers, descriptors=no_or_one),
    _message("node+", request=requests, name=names, namespace=mostly(["/", "/ns"], "", "ns", "/9")),
    _message("node-", node=nodes),
    _message("end-", endpoint=endpoints),
    _message("alive", publisher=publishers),
    _message("ack", subscription=subscriptions, source=publishers, seq=seqs),
    _message("report", endpoint=endpoints, samples=counts, bytes=counts, queued=counts, dropped=drops),
    _message("graph?", request=requests, statistics=st.booleans()),
    _message("observe", request=requests, on=st.booleans()),
    _message("type?", request=requests, type_name=names, type_hash=names),
    _message("type", type_name=names, type_hash=names, schema=schemas),
    _message("ping", number=seqs),
    _message("stop", request=requests),
    st.one_of(
        _message("hello", version=seqs), _message("created", request=requests, id=endpoints), _message("?")
    ),
)
carriers = st.one_of(
    _message("share"), _endpoint("pub+", descriptors=st.just(1)), _message("ring", publisher=publishers)
)
BROUGHT = {"share": 2, "pub+": 1, "ring": 1}
stamps = st.sampled_from([0, -(1 << 63), (1 << 63) - 1, 1_000_000_000_000])
bodies = st.one_of(
    st.lists(st.builds(frame_record, st.just(b"mob"), stamps), min_size=1, max_size=4).map(b"".join),
    st.builds(frame_record, mostly([b"x" * KIB], b"", b"x" * 3 * KIB), stamps),
    st.text("abc\0\x01", max_size=60).map(str.encode),
)
samples = st.tuples(
    publishers, mostly([0], 1, -1, MAX_COUNT), mostly([1, 2], 4, 0, 0xFFFFFFFF), mostly([0], 1, 2, 4), bodies
)
edits = st.lists(st.tuples(st.integers(0, 200), st.integers(0, 127)), max_size=2)
frames = st.one_of(
    st.tuples(st.just("message"), messages, st.just([])),
    st.tuples(st.just("message"), messages, st.just([])),
    st.tuples(st.just("samples"), samples, st.just([])),
    st.tuples(st.just("samples"), samples, st.just([])),
    st.tuples(st.just("carrier"), carriers, st.just([])),
    st.tuples(st.just("message"), messages, edits),
    st.tuples(st.just("samples"), samples, edits),
    st.tuples(st.just("bytes"), st.binary(min_size=1, max_size=40), st.just([])),
)
members = st.integers(0, 2)
steps = st.one_of(
    st.tuples(st.just("say"), members, st.lists(frames, min_size=1, max_size=8)),
    st.tuples(st.just("say"), members, st.lists(frames, min_size=1, max_size=8)),
    st.tuples(st.just("say"), members, st.lists(frames, min_size=1, max_size=8)),
    st.tuples(st.just("block"), members, st.none()),
    st.tuples(st.just("die"), members, st.none()),
    st.tuples(st.just("wait"), members, st.sampled_from([0.1, 1.0, 11.0])),
)


class Member:
    """A process of the mob; it begins with some endpoints to attack. All except the first share memory."""

    def __init__(self, world: World, index: int) -> None:
        self.process = world.process("mob", uid=STRANGER, shares=index > 0)
        node = self.process.node("settler")
        publisher = node.publisher("/good", QoSProfile(depth=3))
        subscription = node.subscription("/good", QoSProfile(history=History.KEEP_ALL))
        self.process.declare_type(NUMBER)
        self.ids = {"node+": [node.id], "pub+": [publisher.id], "sub+": [subscription.id]}
        self.next_seqs = {publisher.id: 1}

    @property
    def is_there(self) -> bool:
        return self.process.id in self.process.world.processes

    def say(self, kind: str, content: Any, edits: list[tuple[int, int]]) -> None:
        if not self.is_there:
            return
        before = len(self.process.sent)
        raw = bytearray(getattr(self, f"_{kind}")(content))
        for place, value in edits:
            raw[place % len(raw)] = value
        self.process.send_bytes(bytes(raw))
        new = self.process.sent[before:]
        if kind in ("message", "carrier") and content["m"] in self.ids:
            self.ids[content["m"]] += [answer.id for answer in new if isinstance(answer, m.Created)]  # type: ignore[operator]

    def _message(self, fields: dict[str, Any]) -> bytes:
        body = msgspec.msgpack.encode({name: self._found(value) for name, value in fields.items()})
        return FRAME_HEAD.pack(FRAME_HEAD_BYTES - LENGTH_BYTES + len(body), CONTROL, 0, 0) + body

    def _carrier(self, fields: dict[str, Any]) -> bytes:
        handles = tuple(Handle("mob") for _ in range(BROUGHT[fields["m"]]))
        self.process._to_broker.descriptors.append(handles)  # type: ignore[arg-type]
        return self._message(fields)

    def _samples(self, content: tuple[Any, int, int, int, bytes]) -> bytes:
        endpoint, ahead, count, flags, body = content
        endpoint = max(0, self._found(endpoint)) & 0xFFFFFFFF
        first_seq = max(0, self.next_seqs.get(endpoint, 1) + ahead)
        self.next_seqs[endpoint] = first_seq + count
        length = DATA_HEAD_BYTES - LENGTH_BYTES + len(body)
        return DATA_HEAD.pack(length, DATA, flags, 0, endpoint, 0, first_seq, count, 0) + body

    @staticmethod
    def _bytes(content: bytes) -> bytes:
        return content

    def _found(self, value: Any) -> Any:
        if not isinstance(value, Mine):
            return value
        ids = self.ids[value.kind]
        return ids[value.index % len(ids)]  # type: ignore[arg-type, index]


@settings(deadline=None, max_examples=examples(100))
@given(st.lists(steps, min_size=5, max_size=25))
def test_a_mob_cannot_hurt_a_polite_pair(story: list[Step]) -> None:
    world = World(LIMITS, access=(ALL_MAY,))
    talker, listener = world.process("talker"), world.process("listener")
    subscription = listener.subscription("/good", QoSProfile(depth=10))
    publisher = talker.publisher("/good", QoSProfile(depth=10))
    mob = [Member(world, index) for index in range(3)]
    for number, (act, index, how) in enumerate(story):
        if not mob[index].is_there:
            mob[index] = Member(world, index)
        match act:
            case "say":
                for what in how:
                    mob[index].say(*what)
            case "block":
                mob[index].process.is_blocked = True
            case "die":
                mob[index].process.die()
            case "wait":
                world.advance(how)
        for polite in (talker, listener):
            polite.tell(m.Ping())
        publisher.publish(f"{number}")

    heard = [sample.payload for sample in subscription.samples if sample.source == publisher.id]
    assert heard == [f"{number}" for number in range(len(story))]
    assert talker.cut_reason is listener.cut_reason is None
    assert world.stop_reason is None

    for member in mob:
        if member.is_there:
            member.process.die()
    graph = talker.graph(statistics=True)
    assert [endpoint.id for endpoint in graph.endpoints] == [publisher.id, subscription.id]
    assert [(match.publisher, match.subscription) for match in graph.matches] == [
        (publisher.id, subscription.id)
    ]
    assert len(world.broker._peers) == 2
    assert set(world.broker.graph.types.trusted) == {TEXT}
    assert set(world.broker.graph.topics) == {"/good"}
    assert len(world.broker.graph.nodes) == 2


@settings(deadline=None)
@given(
    claimed=st.integers(0, 0xFFFFFFFF),
    kind=st.sampled_from([CONTROL, DATA]),
    sent=st.integers(0, 3 * BUFFER_BYTES),
    piece=st.integers(1, BUFFER_BYTES),
)
def test_a_lying_length_costs_no_more_memory_than_what_was_sent(
    claimed: int, kind: int, sent: int, piece: int
) -> None:
    reader = FrameReader(max_control_bytes=1 << 20, max_data_bytes=64 << 20)
    frame = FRAME_HEAD.pack(claimed, kind, 0, 0) + bytes(sent)
    piece = max(piece, len(frame) // 50)
    with suppress(RemoteProtocolError):
        for _ in feed(reader, frame, [piece] * 60):
            pass
    assert len(reader.get_buffer()) <= BUFFER_BYTES + max(4 << 20, len(frame))
