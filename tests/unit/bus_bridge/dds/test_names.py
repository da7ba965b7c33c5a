from bus_bridge.dds import names
from bus_bridge.ros2 import type_names
from rows import for_each


@for_each(
    "dds, kind, topic",
    [
        ("rt/a/b", "topic", "/a/b"),
        ("rt/_hidden", "topic", "/_hidden"),
        ("rq/sRequest", "service", None),
        ("rr/a/sReply", "service", None),
        ("rq/s", "other", None),
        ("ros_discovery_info", "graph", None),
        ("Square", "other", None),
        ("", "other", None),
    ],
)
def test_topics(dds: str, kind: str, topic: str | None) -> None:
    assert names.kind_of(dds) == kind
    assert names.topic_from_dds(dds) == topic
    if topic is not None:
        assert names.topic_to_dds(topic) == dds


@for_each(
    "data, said",
    [
        (b"", {}),
        (b"enclave=/;\0", {"enclave": "/"}),
        (b"typehash=RIHS01_ab;busd=me-1;", {"typehash": "RIHS01_ab", "busd": "me-1"}),
        (b"busd=a;busd=b;", {"busd": "a"}),
        (b"nonsense;;=x;\xff=1;", {"": "x", "\ufffd": "1"}),
    ],
)
def test_what_user_data_says(data: bytes, said: dict[str, str]) -> None:
    assert names.user_data_of(data) == said


def test_user_data_is_read_as_it_was_written() -> None:
    said = {"typehash": "RIHS01_ab", "busd": "robot-1a2b3c4d"}
    assert names.user_data_of(names.user_data(said)) == said


def test_the_node_of_a_participant_without_any_tells_them_apart() -> None:
    one, other = (bytes.fromhex("010f78fd033ee044000000") + bytes([n]) + b"\0\0\1\xc1" for n in (1, 2))
    assert names.bare_node_name(one) == "_dds_010f78fd033ee04400000001" != names.bare_node_name(other)


@for_each(
    "service, type_name", [("/s", "std_srvs/srv/Trigger"), ("/a/_action/get_result", "p/action/F_GetResult")]
)
def test_services(service: str, type_name: str) -> None:
    topics, types = names.service_to_dds(service), names.service_types_to_dds(type_name)
    requests, responses = types
    for topic, type_, is_request in zip(topics, types, (True, False), strict=True):
        assert names.service_part_from_dds(topic, type_) == (service, type_name, is_request)
        for other in (responses if is_request else requests, "p::msg::dds_::Plain_", "unsaid"):
            assert names.service_part_from_dds(topic, other) is None
    assert type_names.type_from_dds(requests) == f"{type_name}_Request"
    assert type_names.type_from_dds(responses) == f"{type_name}_Response"
