"""Services before a request is sent: definitions, envelopes, names, and their place in the graph."""

from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

import bus
from bus import names
from bus.graph import Graph, GraphEndpoint, GraphNode
from bus.msg import Message, int64, string
from bus.msg.geometry_msgs import Point
from bus.srv import std_srvs
from bus.srv.example_interfaces import AddTwoInts
from bus.types.schema import build
from bus.types.service import GID_BYTES, Reply, Request, ServiceSupport, message_of, service_support
from bus.types.support import type_support
from bus_cli.output import CommandError
from bus_cli.service.definitions import full_service_type
from rows import for_each

GID = bytes(range(GID_BYTES))
OTHER = bytes(GID_BYTES)


class Move(bus.Service):
    """A service of a user."""

    class Request(Message, kw_only=True):
        to: Point = msgspec.field(default_factory=Point)

    class Response(Message, kw_only=True):
        at: Point = msgspec.field(default_factory=Point)
        names: list[string] = msgspec.field(default_factory=list)


class Plain:
    """A service without a base class. Its messages are maps."""

    __type_name__ = "demo/srv/Plain"

    class Request(msgspec.Struct):
        name: str = ""

    class Response(msgspec.Struct):
        length: int = 0


class Text(Message, kw_only=True):
    data: string = ""


class Shared(bus.Service):
    """A service with messages that are defined elsewhere and keep their names."""

    Request = Text
    Response = Text


class TestDefinitions:
    def test_names(self) -> None:
        assert AddTwoInts.__type_name__ == "example_interfaces/srv/AddTwoInts"
        assert repr(AddTwoInts.Request(a=1)) == "example_interfaces.srv.AddTwoInts_Request(a=1, b=0)"
        assert Move.__type_name__ == "local/srv/Move"
        assert type_support(Move.Response).name == "local/srv/Move_Response"
        assert type_support(Shared.Request).name == "local/msg/Text"

    def test_made_once(self) -> None:
        assert service_support(Move) is service_support(Move)

    @for_each("wrong", [Text, 3, SimpleNamespace(Request=Text, Response=int)])
    def test_what_is_no_service(self, wrong: Any) -> None:
        with pytest.raises(bus.MessageTypeError):
            ServiceSupport(wrong)

    @for_each("name", ["Move", "demo/msg/Move", "a/srv/b/c", "demo/srv/" + "M" * 250])
    def test_bad_names(self, name: str) -> None:
        with pytest.raises(bus.ConfigurationError):
            ServiceSupport(SimpleNamespace(__type_name__=name, Request=Text, Response=Text))

    def test_a_definition_that_differs_in_one_part_differs_on_both_topics(self) -> None:
        class Other(msgspec.Struct, array_like=True):
            data: string = ""
            more: int64 = 0

        same = [
            ServiceSupport(SimpleNamespace(__type_name__="demo/srv/A", Request=Text, Response=answer))
            for answer in (Text, Other, Text)
        ]
        requests = [one.requests.hash for one in same]
        replies = [one.replies(GID).hash for one in same]
        for hashes in (requests, replies):
            assert hashes[0] == hashes[2]
            assert hashes[0] != hashes[1]
        assert {one.requests.name for one in same} == {"demo/srv/A_Request"}
        assert {one.replies(GID).name for one in same} == {"demo/srv/A_Response"}


class TestEnvelopes:
    @for_each(
        ("service", "request_", "response"),
        [
            (AddTwoInts, AddTwoInts.Request(a=-1, b=2**62), AddTwoInts.Response(sum=3)),
            (Move, Move.Request(to=Point(x=1.5)), Move.Response(names=["a", "ü"])),
            (Plain, Plain.Request(name="x"), Plain.Response(length=1)),
            (Shared, Text(data="q"), Text(data="a")),
            (std_srvs.Empty, std_srvs.Empty.Request(), std_srvs.Empty.Response()),
        ],
    )
    def test_there_and_back(self, service: Any, request_: Any, response: Any) -> None:
        both = service_support(service)
        assert both.requests.decode(both.encode_request(GID, 7, request_)) == Request(GID, 7, request_)
        sent = both.encode_response(GID, 2**63, response)
        assert both.replies(GID).decode(sent) == Reply(GID, 2**63, "", response)
        assert both.replies(OTHER).decode(sent) == Reply(GID, 2**63, "", None)

    @for_each(
        ("text", "shown"),
        [("no", "no"), ("", "no reason is given"), ("\ud800", "?"), ("x" * 9999, "x" * 2000)],
    )
    def test_an_error_is_always_text(self, text: str, shown: str) -> None:
        both = service_support(AddTwoInts)
        assert both.replies(GID).decode(both.encode_error(GID, 1, text)) == Reply(GID, 1, shown, None)

    @for_each(
        ("wrong", "text"),
        [
            (AddTwoInts.Response(), "expected a bus.srv.example_interfaces.AddTwoInts.Request, got"),
            ({"a": 1}, "got dict"),
            (AddTwoInts.Request(a="1"), r"Expected `int`, got `str` - at `\$.a`"),  # type: ignore[arg-type]
            (AddTwoInts.Request(a=2**70), r"at `\$.a`"),
        ],
    )
    def test_wrong_requests(self, wrong: Any, text: str) -> None:
        with pytest.raises(bus.MessageTypeError, match=text):
            service_support(AddTwoInts).encode_request(GID, 1, wrong)

    def test_a_wrong_response(self) -> None:
        with pytest.raises(bus.MessageTypeError, match=r"AddTwoInts_Response: expected a .* got NoneType"):
            service_support(AddTwoInts).encode_response(GID, 1, None)

    @for_each("data", [b"", b"\xc0", b"\x93\xc0\x01\x90", b"\x93\xc4\x01a\x01\xa1a"])
    def test_what_is_no_envelope(self, data: bytes) -> None:
        with pytest.raises(msgspec.DecodeError):
            service_support(AddTwoInts).requests.decode(data)

    @for_each("service", [AddTwoInts, Move, Plain, Shared, std_srvs.Empty])
    def test_out_of_what_travels_with_discovery(self, service: Any) -> None:
        both = service_support(service)
        made = [message_of(build(support.schema)) for support in (both.requests, both.replies(GID))]
        for cls, part in zip(made, ("Request", "Response"), strict=True):
            assert type_support(cls).name == f"{both.name}_{part}"
        again = ServiceSupport(SimpleNamespace(__type_name__=both.name, Request=made[0], Response=made[1]))
        expected = SimpleNamespace(
            __type_name__=both.name, Request=service.Request, Response=service.Response
        )
        assert again.requests.hash == ServiceSupport(expected).requests.hash

    def test_a_schema_of_something_else(self) -> None:
        with pytest.raises(bus.ConfigurationError, match="local/msg/Text on the bus is no request"):
            message_of(Text)


class TestNames:
    def test_topics(self) -> None:
        assert names.request_topic("/ns/add") == "/ns/add/_request"
        assert names.reply_topic("/ns/add") == "/ns/add/_reply"
        assert names.is_hidden_topic("/add/_request")
        assert (
            names.service_of_topic("/ns/add/_request")
            == names.service_of_topic("/ns/add/_reply")
            == "/ns/add"
        )

    @for_each("topic", ["/add", "/_request", "/_reply", "/add_request", "/add/_request/x"])
    def test_other_topics(self, topic: str) -> None:
        assert names.service_of_topic(topic) is None

    def test_types(self) -> None:
        assert (
            full_service_type("std_srvs/Empty")
            == full_service_type("std_srvs/srv/Empty")
            == "std_srvs/srv/Empty"
        )

    @for_each("text", ["", "Empty", "/Empty", "a/b/c/d", "std_msgs/msg/String"])
    def test_no_types(self, text: str) -> None:
        with pytest.raises(CommandError, match="The passed service type is invalid"):
            full_service_type(text)


def test_the_graph_knows_who_serves() -> None:
    server, client, tool = (
        GraphNode(id=number, name=f"n{number}", namespace="/", pid=1) for number in (1, 2, 3)
    )

    def endpoint(kind: str, node: GraphNode, topic: str, part: str) -> GraphEndpoint:
        name = f"std_srvs/srv/Empty_{part}"
        return GraphEndpoint(0, kind, node, topic, name, "", b"", bus.QoSProfile())

    graph = Graph(
        revision=1,
        broker_pid=1,
        nodes=(server, client, tool),
        publishers=(
            endpoint("publisher", server, "/a/_reply", "Response"),
            endpoint("publisher", client, "/a/_request", "Request"),
            endpoint("publisher", client, "/b/_request", "Request"),
        ),
        subscriptions=(
            endpoint("subscription", server, "/a/_request", "Request"),
            endpoint("subscription", tool, "/a/_request", "Request"),  # only observes
            endpoint("subscription", client, "/a/_reply", "Response"),
            endpoint("subscription", client, "/b/_reply", "Response"),
        ),
        matches=(),
    )
    assert graph.services() == {"/a": ["std_srvs/srv/Empty"], "/b": ["std_srvs/srv/Empty"]}
    assert [one.node for one in graph.servers_of("/a")] == [server]
    assert [one.node for one in graph.clients_of("/a")] == [client]
    assert (graph.servers_of("/b"), graph.clients_of("/c")) == ([], [])
