"""What busd would answer a client, and each rule that the client can break."""

from typing import Any

import pytest

from bus.msg.std_msgs import Int32, String
from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus.types.support import type_support
from bus.wire import messages as m
from bus.wire.runs import Run
from bus.wire.session import Role, Session
from bus_cli.doctor.conformance.conversation import (
    USUAL,
    Conversation,
    Terms,
    Wrong,
    gid_of_partner,
    is_plain,
)
from feeding import feed, frame_record
from rows import for_each

NOW_NS = 50_000_000_000
STARTED_NS = 40_000_000_000
GID, OTHER_GID = bytes(range(16)), bytes(range(16, 32))
SCHEMA = MessageSchema.of(String)
TYPE = m.DeclareType(type_name=SCHEMA.type_name, type_hash=SCHEMA.type_hash, schema=SCHEMA.encoded)
ENCODE = type_support(String).encode


def publisher(request: int = 2, gid: bytes = GID, **changes: Any) -> m.CreatePublisher:
    fields: dict[str, Any] = {"node": 41, "topic": "/topic", "qos": QoSProfile()} | changes
    return m.CreatePublisher(
        request=request, gid=gid, type_name=SCHEMA.type_name, type_hash=SCHEMA.type_hash, **fields
    )


def subscription(request: int = 3, gid: bytes = OTHER_GID, **changes: Any) -> m.CreateSubscription:
    fields: dict[str, Any] = {"node": 41, "topic": "/topic", "qos": QoSProfile()} | changes
    return m.CreateSubscription(
        request=request, gid=gid, type_name=SCHEMA.type_name, type_hash=SCHEMA.type_hash, **fields
    )


def run(first_seq: int = 1, *stamps_ns: int, endpoint: int = 42, body: bytes = b"", only_for: int = 0) -> Run:
    body = body or ENCODE(String(data="hi"))
    records = b"".join(frame_record(body, stamp_ns) for stamp_ns in stamps_ns or (NOW_NS,))
    return Run(endpoint, 0, first_seq, len(stamps_ns) or 1, records, only_for=only_for)


def talk(*messages: Any, terms: Terms = USUAL) -> tuple[Conversation, list[m.Message]]:
    """A conversation after these messages, and the answers to all."""
    one = Conversation(41, STARTED_NS, terms)
    answers = [
        answer
        for message in (m.CreateNode(request=1, name="n"), *messages)
        for answer in one.hear(message, NOW_NS)
    ]
    return one, answers


def test_the_answers() -> None:
    one, answers = talk(
        TYPE, publisher(), subscription(qos=QoSProfile(history="keep_all")), m.Ping(number=7), m.Ping()
    )
    assert [type(answer) for answer in answers] == [
        *(m.Created, m.Created, m.Matched, m.Created, m.Matched, m.Pong)
    ]
    assert [answer.id for answer in answers if isinstance(answer, m.Created)] == [41, 42, 44]
    assert [answer.depth for answer in answers if isinstance(answer, m.Created)] == [0, 10, 0]
    assert [(one.endpoint, one.other) for one in answers if isinstance(one, m.Matched)] == [
        (42, 43),
        (44, 45),
    ]
    assert answers[-1] == m.Pong(number=7)
    assert (one.declared, one.heard) == (4, 6)


def test_the_graph_may_be_asked_for() -> None:
    _, answers = talk(m.GetGraph(request=5), m.Observe(request=6), m.StopBroker(request=7))
    assert [type(answer) for answer in answers[1:]] == [m.GraphSnapshot, m.GraphSnapshot, m.Refused]


def test_samples_are_counted_and_kept_and_credit_comes_for_a_lossless_publisher() -> None:
    qos = QoSProfile(history="keep_all")
    one, answers = talk(TYPE, publisher(qos=qos, next_seq=5), run(5, STARTED_NS, NOW_NS), run(9))
    endpoint = one.endpoints[42]
    assert (endpoint.samples, endpoint.last_seq) == (3, 9)
    assert list(endpoint.payloads) == [ENCODE(String(data="hi"))] * 3
    assert answers[-2:] == [m.Credit(publisher=42, seq=6), m.Credit(publisher=42, seq=9)]


def test_samples_for_a_subscription() -> None:
    one, _ = talk(TYPE, subscription(2, last_seqs={gid_of_partner("/topic"): 4}))
    raw = one.feed(one.endpoints[42], [b"\x91\xa1a", b"\x91\xa1b"], NOW_NS)
    hello = m.encode_frame(m.Hello(version=1))
    (_, found) = list(feed(Session(Role.CLIENT), hello + raw))
    assert (found.endpoint, found.source, found.first_seq, found.count) == (42, 43, 5, 2)
    assert [bytes(payload) for payload, _ in found.records()] == [b"\x91\xa1a", b"\x91\xa1b"]
    one.hear(m.Ack(subscription=42, source=43, seq=6), NOW_NS)
    assert one.endpoints[42].acknowledged == 6


def test_the_window_of_a_lossless_publisher() -> None:
    qos, terms = QoSProfile(history="keep_all"), Terms(window_samples=3, gives_credit=False)
    one, answers = talk(TYPE, publisher(qos=qos, next_seq=5), run(5), run(6), run(7), terms=terms)
    created = next(answer for answer in answers if isinstance(answer, m.Created) and answer.id == 42)
    assert (created.window_samples, type(answers[-1])) == (3, m.Matched)
    assert one.give_credit(one.endpoints[42]) == m.Credit(publisher=42, seq=7)
    one.hear(run(8, NOW_NS, NOW_NS, NOW_NS), NOW_NS)
    with pytest.raises(Wrong, match=r"sent sample 11; its credit is 7, and window_samples of Created is 3"):
        one.hear(run(11), NOW_NS)


def test_the_window_is_of_lossless_publishers_only() -> None:
    one, _ = talk(TYPE, publisher(), run(1), run(2), terms=Terms(window_samples=1, gives_credit=False))
    assert one.endpoints[42].samples == 2


def test_terms_are_for_topics_of_users_only() -> None:
    ends = (publisher(2, topic="/rosout"), publisher(3, OTHER_GID))
    _, answers = talk(TYPE, *ends, terms=Terms(max_message_bytes=200))
    created = [answer for answer in answers if isinstance(answer, m.Created)]
    assert [answer.max_message_bytes for answer in created] == [0, 1 << 20, 200]


def test_another_endpoint_replaces_the_partner() -> None:
    one, _ = talk(TYPE, subscription(2, qos=QoSProfile(history="keep_all")))
    end = one.endpoints[42]
    one.feed(end, [b"\x91\xa1a"], NOW_NS)
    one.hear(m.Ack(subscription=42, source=43, seq=1), NOW_NS)
    unmatched, matched = one.replace_partner(end)
    assert isinstance(unmatched, m.Unmatched) and isinstance(matched, m.Matched)
    assert (unmatched.endpoint, unmatched.other, unmatched.last_seq) == (42, 43, 1)
    assert (matched.endpoint, matched.other, matched.next_seq) == (42, 44, 1)
    assert matched.gid == gid_of_partner("/topic", 2) != gid_of_partner("/topic")
    assert (end.samples, end.last_seq, end.acknowledged) == (1, 0, 0)
    with pytest.raises(Wrong, match="Ack names source 43; the publisher of"):
        one.hear(m.Ack(subscription=42, source=43, seq=1), NOW_NS)


def test_only_endpoints_on_topics_of_users_are_refused() -> None:
    terms = Terms(refuses="no")
    one, answers = talk(TYPE, publisher(2, topic="/rosout"), publisher(3, OTHER_GID), terms=terms)
    assert answers[-1] == m.Refused(request=3, text="no")
    assert (one.refused, [end.topic for end in one.endpoints.values()]) == (1, ["/rosout"])


def test_a_destroyed_node_takes_its_endpoints_along() -> None:
    one, _ = talk(TYPE, publisher(), m.DestroyNode(node=41))
    assert (one.nodes, one.endpoints) == ({}, {})


@for_each(
    ("topic", "expected"),
    [("/topic", True), ("/rosout", False), ("/add/_request", False), ("/parameter_events", False)],
)
def test_topics_of_users(topic: str, expected: bool) -> None:
    assert is_plain(topic) is expected


INT32 = MessageSchema.of(Int32)
LATER_NS = NOW_NS + 1_000_000_000

MISTAKES: list[tuple[tuple[Any, ...], str]] = [
    ((m.CreateNode(request=1, name="m"),), "request 1 came twice"),
    ((m.CreateNode(request=2, name="a b"),), "CreateNode: Invalid node name"),
    ((m.CreateNode(request=2, name="a", namespace="b"),), "CreateNode: Invalid namespace"),
    (
        (m.DeclareType(type_name="a/msg/A", type_hash="x", schema=b"\x01"),),
        "DeclareType of a/msg/A has a bad schema",
    ),
    (
        (m.DeclareType(type_name="a/msg/A", type_hash=INT32.type_hash, schema=INT32.encoded),),
        "DeclareType of a/msg/A has the schema of std_msgs/msg/Int32",
    ),
    (
        (m.DeclareType(type_name=INT32.type_name, type_hash="RIHS01_0", schema=INT32.encoded),),
        f"DeclareType of std_msgs/msg/Int32 says RIHS01_0; its schema has {INT32.type_hash}",
    ),
    ((publisher(),), f"without a DeclareType of std_msgs/msg/String with {SCHEMA.type_hash}"),
    ((TYPE, publisher(node=1)), "CreatePublisher names node 1; its nodes are 41 (from Created)"),
    ((TYPE, publisher(topic="topic")), "CreatePublisher: Invalid topic name"),
    ((TYPE, publisher(gid=b"abc")), "CreatePublisher on /topic has a gid of 3 bytes; it has 16"),
    ((TYPE, publisher(), subscription(gid=GID)), "has the gid of publisher 42 on /topic"),
    ((m.DestroyNode(node=42),), "DestroyNode names node 42; its nodes are 41"),
    ((m.DestroyEndpoint(endpoint=9),), "DestroyEndpoint names 9; its endpoints are none"),
    ((m.Report(endpoint=9, samples=0, bytes=0),), "Report names 9"),
    ((TYPE, subscription(2), m.AssertLiveliness(publisher=42)), "AssertLiveliness names 42; its publishers"),
    (
        (TYPE, publisher(), m.Ack(subscription=42, source=43, seq=1)),
        "Ack names 42; its subscriptions are none",
    ),
    (
        (TYPE, subscription(2), m.Ack(subscription=42, source=1, seq=1)),
        "Ack names source 1; the publisher of",
    ),
    (
        (TYPE, subscription(2), m.Ack(subscription=42, source=43, seq=1)),
        "Ack of sample 1; subscription 42 on",
    ),
    ((m.Share(), m.Share()), "Share came twice"),
    ((TYPE, publisher(), m.Share()), "Share came after the first endpoint"),
    ((TYPE, subscription(2), m.Attach(subscription=42, source=43, slot=0)), "Attach came, but all matches"),
    ((TYPE, run(endpoint=2)), "a data frame names 2; its publishers are none"),
    ((TYPE, subscription(2), run()), "a data frame names 42; its publishers are none"),
    ((TYPE, publisher(), run(only_for=9)), "is for subscription 9 only"),
    (
        (TYPE, publisher(next_seq=7), run(6)),
        "publisher 42 on /topic sent sample 6; its next number is at least 7",
    ),
    ((TYPE, publisher(), run(), run()), "sent sample 1; its next number is at least 2"),
    (
        (TYPE, publisher(), run(1, LATER_NS)),
        "sample 1 of publisher 42 on /topic is stamped 1.0 s in the future",
    ),
    ((TYPE, publisher(), run(1, STARTED_NS - 1)), "is stamped 0.0 s before the client's start"),
    (
        (TYPE, publisher(), run(1, NOW_NS, NOW_NS - 1)),
        "sample 2 of publisher 42 on /topic is stamped before the",
    ),
    ((TYPE, publisher(), run(body=b"\xa2hi")), "is no std_msgs/msg/String: Expected `array`, got `str`"),
    (
        (TYPE, publisher(), run(body=b"\xc4" * 1_048_577)),
        "has 1048577 bytes; max_message_bytes of Created is 1048576",
    ),
]


@for_each(("messages", "text"), MISTAKES)
def test_mistakes(messages: tuple[Any, ...], text: str) -> None:
    """The last message is the mistake."""
    one, _ = talk(*messages[:-1])
    with pytest.raises(Wrong) as caught:
        one.hear(messages[-1], NOW_NS)
    assert text in str(caught.value), str(caught.value)
