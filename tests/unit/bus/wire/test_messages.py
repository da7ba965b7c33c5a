"""bus.wire.messages: the encoding of control messages, and refused values."""

from typing import Any, ClassVar, get_args

import msgspec
import pytest

from bus.errors import RemoteProtocolError
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import FRAME_HEAD, FRAME_HEAD_BYTES, MAX_COUNT
from rows import for_each

FROM_CLIENT = get_args(m.FromClient)
FROM_BROKER = get_args(m.FromBroker)
EVERY = sorted({*FROM_CLIENT, *FROM_BROKER}, key=lambda kind: kind.__name__)
BOTH_WAYS = {m.Hello, m.Ping, m.Pong}


def body_of(message: m.Message) -> dict[str, Any]:
    found: dict[str, Any] = msgspec.msgpack.decode(m.encode_frame(message)[FRAME_HEAD_BYTES:])
    return found


def decode(**fields: Any) -> Any:
    return m.from_client.decode(msgspec.msgpack.encode(fields))


def refusal(**fields: Any) -> str:
    with pytest.raises(RemoteProtocolError) as caught:
        decode(**fields)
    return str(caught.value)


class TestTags:
    def test_each_message_has_one_of_its_own(self) -> None:
        tags = [kind.__struct_config__.tag for kind in EVERY]
        assert len(set(tags)) == len(tags)

    def test_both_unions_together_hold_every_message(self) -> None:
        assert set(EVERY) == set(m.Message.__subclasses__())
        assert set(FROM_CLIENT) & set(FROM_BROKER) == BOTH_WAYS

    def test_every_request_has_an_answer_that_carries_its_number(self) -> None:
        requests = {kind for kind in FROM_CLIENT if "request" in kind.__struct_fields__}
        answers = {kind for kind in FROM_BROKER if "request" in kind.__struct_fields__}
        endpoints = {m.CreatePublisher, m.CreateSubscription}
        asked = {m.GetGraph, m.GetType, m.GetPeers, m.Observe}
        assert requests == {m.CreateNode, *endpoints, *asked, m.StopBroker, m.Reload}
        assert answers == {m.Created, m.Done, m.Refused, m.GraphSnapshot, m.TypeDescription, m.Peers}


class TestEncoding:
    def test_length_counts_what_follows_it(self) -> None:
        frame = m.encode_frame(m.Ping(number=300))
        assert FRAME_HEAD.unpack_from(frame)[0] == len(frame) - 4

    def test_a_tagged_map_without_defaults(self) -> None:
        assert body_of(m.CreateNode(request=3, name="talker")) == {
            "m": "node+",
            "request": 3,
            "name": "talker",
        }

    def test_a_qos_profile_says_what_differs_from_the_default(self) -> None:
        message = m.Matched(endpoint=1, other=2, node="/a", gid=b"", qos=QoSProfile(depth=3))
        assert body_of(message)["qos"] == {"depth": 3}

    def test_a_schema_travels_untouched(self) -> None:
        schema = msgspec.msgpack.encode({"fields": [1, None]})
        message = m.from_client.decode(
            m.encode_frame(m.DeclareType(type_name="a", type_hash="b", schema=schema))[FRAME_HEAD_BYTES:]
        )
        assert bytes(message.schema) == bytes(schema)

    def test_a_schema_that_is_left_out_is_nil(self) -> None:
        assert bytes(decode(m="type", type_name="a", type_hash="b").schema) == b"\xc0"


class TestValues:
    """busd refuses values on arrival that would break it later, when it counts or encodes them."""

    REPORT: ClassVar[dict[str, Any]] = {"m": "report", "endpoint": 1, "samples": 0, "bytes": 0}

    @for_each("field", ["samples", "bytes", "queued"])
    @for_each("value", [-1, MAX_COUNT + 1, 2**64 - 1])
    def test_counters_of_a_report(self, field: str, value: int) -> None:
        assert f"$.{field}" in refusal(**(self.REPORT | {field: value}))

    @pytest.mark.parametrize("value", [-1, MAX_COUNT + 1])
    def test_drops_of_a_report(self, value: int) -> None:
        assert "$.dropped" in refusal(**self.REPORT, dropped={"replaced": value})

    def test_a_report_cannot_be_long(self) -> None:
        """busd keeps the last report of each endpoint."""
        assert "$.dropped" in refusal(**self.REPORT, dropped={f"reason {n}": 1 for n in range(100)})
        assert "$.dropped" in refusal(**self.REPORT, dropped={"x" * 1000: 1})

    def test_the_largest_report(self) -> None:
        report = decode(**(self.REPORT | {"samples": MAX_COUNT}), dropped={"memory_limit": MAX_COUNT})
        assert report.samples == report.dropped["memory_limit"] == MAX_COUNT

    @for_each("value", [-1, 0, MAX_COUNT + 1])
    def test_the_first_number_of_a_publisher(self, value: int) -> None:
        text = refusal(
            m="pub+",
            request=1,
            node=1,
            topic="/a",
            type_name="a",
            type_hash="b",
            qos={},
            gid=b"",
            next_seq=value,
        )
        assert "$.next_seq" in text

    @for_each(
        "known",
        [
            {bytes(16): MAX_COUNT + 1},
            {bytes(17): 1},
            {number.to_bytes(16, "big"): 1 for number in range(1025)},
        ],
    )
    def test_what_a_subscription_knows_cannot_be_long(self, known: dict[bytes, int]) -> None:
        """busd keeps some of these numbers."""
        endpoint = {"request": 1, "node": 1, "topic": "/a", "type_name": "a", "type_hash": "b", "gid": b""}
        assert "last_seqs" in refusal(m="sub+", qos={}, **endpoint, last_seqs=known)

    @for_each(
        ("field", "most"),
        [("capabilities", ("c" * 64,) * 64), ("program", "p" * 1000), ("release", "r" * 1000)],
    )
    def test_a_hello_cannot_be_long(self, field: str, most: Any) -> None:
        """busd keeps it as long as the connection exists."""
        assert getattr(decode(m="hello", version=1, **{field: most}), field) == most
        assert field in refusal(m="hello", version=1, **{field: most + most[:1]})

    def test_nor_can_a_capability(self) -> None:
        assert "capabilities" in refusal(m="hello", version=1, capabilities=["c" * 65])

    def test_a_qos_profile_that_is_none(self) -> None:
        for qos in (
            {"depth": 0},
            {"depth": -1},
            {"history": "keep_some"},
            {"deadline": -1.0},
            {"lifespan": float("nan")},
        ):
            text = refusal(
                m="sub+", request=1, node=1, topic="/a", type_name="a", type_hash="b", qos=qos, gid=b""
            )
            assert "$.qos" in text
