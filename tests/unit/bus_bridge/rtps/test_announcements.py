"""Descriptions of participants and endpoints, and the rules of matching."""

import struct

import pytest

from bus_bridge.rtps.announcements import (
    EndpointData,
    EndpointKind,
    ParticipantData,
    departed,
    inline_qos,
    is_match,
    read_endpoint,
    read_participant,
    write_endpoint,
    write_participant,
)
from bus_bridge.rtps.ids import OUR_VENDOR, PARTICIPANT, reader_id, writer_id
from bus_bridge.rtps.parameters import (
    FOREVER_NS,
    RtpsError,
    read_parameters,
    write_number,
    write_octets,
    write_parameters,
    write_text,
)
from bus_bridge.rtps.policies import Policies
from rows import for_each

PREFIX, OTHER = b"p" * 12, b"o" * 12
WRITER = EndpointData("writer", PREFIX + writer_id(1), "rt/a", "std_msgs::msg::dds_::String_")
READER = WRITER._replace(kind="reader", guid=OTHER + reader_id(1))
HEAD = b"\0\3\0\0"


def test_a_participant() -> None:
    data = ParticipantData(
        PREFIX,
        OUR_VENDOR,
        (("127.0.0.1", 7410), ("10.0.0.1", 7410)),
        (("127.0.0.1", 7411),),
        20_000_000_000,
        b"enclave=/;",
    )
    assert read_participant(write_participant(data), PREFIX) == data


def test_a_participant_that_says_little() -> None:
    found = read_participant(HEAD + write_parameters([]), PREFIX)
    assert found == ParticipantData(PREFIX, bytes(2), (), (), 100_000_000_000, b"")


@for_each(
    "data",
    [
        WRITER,
        READER,
        WRITER._replace(
            policies=Policies(False, 1, True, 7, 1_500_000_000, 2_000_000_001, 2, 3_000_000_000),
            user_data=b"typehash=RIHS01_00;",
            addresses=(("10.0.0.2", 7413),),
        ),
    ],
)
def test_an_endpoint(data: EndpointData) -> None:
    assert read_endpoint(write_endpoint(data), data.kind) == data


def endpoint_with(key: int, value: bytes, kind: EndpointKind = "writer") -> EndpointData:
    guid = PREFIX + (writer_id(1) if kind == "writer" else reader_id(1))
    parameters = [(0x05, write_text("t")), (0x07, write_text("T")), (0x5A, guid), (key, value)]
    return read_endpoint(HEAD + write_parameters(parameters), kind)


def test_defaults() -> None:
    writer = endpoint_with(0x00, b"")
    assert writer.policies == Policies() and writer.is_default_partition
    assert writer.representations == (0,)
    assert not endpoint_with(0x00, b"", "reader").policies.reliable


def test_partitions() -> None:
    one = write_text("robot")
    assert not endpoint_with(0x29, write_number(1) + one).is_default_partition
    assert endpoint_with(0x29, write_number(0)).is_default_partition
    both = write_number(2) + one + bytes(-len(one) % 4) + write_text("")
    assert endpoint_with(0x29, both).is_default_partition


def test_representations() -> None:
    assert endpoint_with(0x73, struct.pack("<IHH", 2, 2, 0)).representations == (2, 0)
    assert endpoint_with(0x73, write_number(0)).representations == (0,)
    with pytest.raises(RtpsError, match="3 representations"):
        endpoint_with(0x73, struct.pack("<IHH", 3, 2, 0))


@for_each(
    "parameters, text",
    [
        ([(0x05, write_text("t")), (0x07, write_text("T"))], "without a GUID"),
        ([(0x5A, PREFIX + reader_id(1))], "a writer with the id 00000104"),
        ([(0x5A, PREFIX)], "a GUID of 12 bytes"),
        ([(0x5A, PREFIX + writer_id(1)), (0x05, write_text("t"))], "without a topic or a type"),
        (
            [(0x5A, PREFIX + writer_id(1)), (0x05, write_text("t" * 1025)), (0x07, write_text("T"))],
            "more than 1024 characters",
        ),
        (
            [
                (0x5A, PREFIX + writer_id(1)),
                (0x05, write_text("t")),
                (0x07, write_text("T")),
                (0x2C, write_octets(bytes(8193))),
            ],
            "8193 bytes of user data",
        ),
    ],
)
def test_an_endpoint_that_can_t_be(parameters: list[tuple[int, bytes]], text: str) -> None:
    with pytest.raises(RtpsError, match=text):
        read_endpoint(HEAD + write_parameters(parameters), "writer")


@for_each("payload", [b"", b"\0\3", b"\0\1\0\0" + write_parameters([]), b"\0\3\0\0"])
def test_an_announcement_that_can_t_be(payload: bytes) -> None:
    with pytest.raises(RtpsError):
        read_participant(payload, PREFIX)


def test_nobody_speaks_for_another() -> None:
    payload = HEAD + write_parameters([(0x50, OTHER + PARTICIPANT)])
    with pytest.raises(RtpsError, match="by another one"):
        read_participant(payload, PREFIX)


def test_big_endian() -> None:
    parameters = struct.pack(
        ">HH16sHHI4sHHI4sHH", 0x5A, 16, PREFIX + writer_id(1), 5, 8, 2, b"t\0", 7, 8, 2, b"T\0", 1, 0
    )
    found = read_endpoint(b"\0\2\0\0" + parameters, "writer")
    assert (found.topic, found.type_name) == ("t", "T")


def test_departures() -> None:
    guid = PREFIX + writer_id(3)
    inline = read_parameters(inline_qos(gone=guid), "<").parameters
    assert departed(None, inline) == guid
    assert departed(None, {}) is None
    assert departed(None, {0x71: [bytes(4)]}) is None
    gone = {0x71: [b"\0\0\0\1"]}
    assert departed(None, gone) == b""
    assert departed(HEAD + write_parameters([(0x5A, guid)]), gone) == guid
    assert departed(HEAD + write_parameters([(0x50, guid)]), gone) == guid


@for_each(
    "asked, offered, fits",
    [
        (Policies(), Policies(), True),
        (Policies(), Policies(reliable=False), False),
        (Policies(reliable=False), Policies(), True),
        (Policies(durability=1), Policies(), False),
        (Policies(), Policies(durability=1), True),
        (Policies(deadline_ns=5), Policies(), False),
        (Policies(deadline_ns=5), Policies(deadline_ns=6), False),
        (Policies(deadline_ns=5), Policies(deadline_ns=5), True),
        (Policies(), Policies(deadline_ns=5), True),
        (Policies(liveliness=2), Policies(), False),
        (Policies(), Policies(liveliness=2), True),
        (Policies(lease_ns=5), Policies(lease_ns=FOREVER_NS), False),
    ],
)
def test_matching_qos(asked: Policies, offered: Policies, fits: bool) -> None:
    reader, writer = READER._replace(policies=asked), WRITER._replace(policies=offered)
    assert is_match(reader, writer) is is_match(writer, reader) is fits


@for_each(
    "far",
    [
        READER._replace(topic="rt/b"),
        READER._replace(type_name="other"),
        READER._replace(kind="writer"),
        READER._replace(is_default_partition=False),
        READER._replace(representations=(2,)),
    ],
)
def test_endpoints_that_don_t_match(far: EndpointData) -> None:
    assert is_match(WRITER, READER)
    assert not is_match(WRITER, far)
