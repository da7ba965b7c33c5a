"""bus_bridge.ros2.service_ways: ends of services in ROS 2, and the routes of their messages."""

from collections.abc import AsyncIterator, Callable
from typing import Any, Literal

import pytest

from bridged_world import until
from bus.names import reply_topic, request_topic
from bus.qos import QoSProfile
from bus.srv.example_interfaces import AddTwoInts
from bus.types.service import Reply, service_support
from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.dds.services import Services
from bus_bridge.engine import EndpointKind, FarEndpoint, LocalEndpoint, LocalNode, Writer
from bus_bridge.errors import BridgeError
from bus_bridge.ros2.service_types import KnownServices, ServiceTypes
from bus_bridge.ros2.service_ways import ServiceWays
from ports import own_domain

DOMAIN = own_domain()
ADD = ServiceTypes.find("example_interfaces/srv/AddTwoInts")
TRIGGER = ServiceTypes.find("std_srvs/srv/Trigger")
SUPPORT = service_support(AddTwoInts)
CLIENT = b"c" * 16
NODE = LocalNode(1, "node", "/")
Topic = Literal["requests", "replies"]


def name_of(topic: Topic) -> str:
    return request_topic("/add") if topic == "requests" else reply_topic("/add")


def local(kind: EndpointKind, topic: Topic) -> LocalEndpoint:
    schema = ADD.requests if topic == "requests" else ADD.replies
    return LocalEndpoint(
        kind, b"l" * 16, NODE, name_of(topic), schema.type_name, schema.type_hash, QoSProfile(10)
    )


def far(gid: bytes, topic: Topic) -> FarEndpoint:
    """A far publisher."""
    return FarEndpoint("publisher", gid, "key", name_of(topic), "", "", QoSProfile(10))


class Side:
    """A bus, as the engine sees it."""

    def __init__(self) -> None:
        self.gone: list[bytes] = []
        self.shown: list[tuple[bytes, bytes]] = []
        self.warnings: list[str] = []
        self.room: list[str] = []
        self.known = KnownServices()
        self.services = Services(DOMAIN, self.warnings.append, self.gone.append)
        self.ways = ServiceWays(self.services, self.known, b"", self._show)

    def _show(self, node: LocalNode, guids: tuple[bytes, bytes], is_there: bool) -> None:
        assert node is NODE
        (self.shown.append if is_there else self.shown.remove)(guids)

    def subscribe(self, topic: Topic) -> Callable[[], None]:
        schema = ADD.requests if topic == "requests" else ADD.replies
        return self.ways.announce_subscription(local("subscription", topic), schema)

    def publish(self, topic: Topic) -> Writer:
        schema = ADD.requests if topic == "requests" else ADD.replies
        return self.ways.announce_publisher(
            local("publisher", topic), schema, lambda: self.room.append(topic)
        )

    def close(self) -> None:
        self.ways.close()
        self.services.close()
        assert self.shown == []


def one(payload: bytes) -> Batch:
    return Loose([Sample(payload, 1, 0)])


def payloads(batches: list[Batch]) -> list[bytes]:
    return [sample.payload for batch in batches for sample in batch]


class World:
    """A bus with a server, and one with a client."""

    def __init__(self) -> None:
        self.here, self.there = Side(), Side()
        self.asked: list[Batch] = []
        self.answers: list[Batch] = []

    def serve(self) -> None:
        self.withdraw = self.here.subscribe("requests")
        self.server = self.here.publish("replies")

    def ask(self) -> None:
        self.there.subscribe("replies")
        self.client = self.there.publish("requests")

    def call(self, number: int) -> None:
        request = AddTwoInts.Request(a=number, b=1)
        assert self.client.write(one(SUPPORT.encode_request(CLIENT, number, request))) == 1

    def answer(self, payload: bytes) -> None:
        request = SUPPORT.requests.decode(payload)
        response = AddTwoInts.Response(sum=request.body.a + request.body.b)
        assert self.server.write(one(SUPPORT.encode_response(request.client, request.number, response))) == 1

    def read_requests(self) -> Any:
        ((_, writer),) = self.there.shown
        return self.here.ways.read(far(writer, "requests"), self.asked.append)

    def read_replies(self) -> Any:
        ((_, writer),) = self.here.shown
        return self.there.ways.read(far(writer, "replies"), self.answers.append)

    def replies(self) -> list[Reply]:
        return [SUPPORT.replies(CLIENT).decode(payload) for payload in payloads(self.answers)]


@pytest.fixture
async def world() -> AsyncIterator[World]:
    made = World()
    yield made
    made.there.close()
    made.here.close()


async def test_a_call_and_its_answer(world: World) -> None:
    world.serve()
    world.ask()
    world.read_requests()
    world.read_replies()
    world.call(1)
    await until(lambda: world.asked)
    world.answer(payloads(world.asked)[0])
    await until(lambda: world.answers)
    (reply,) = world.replies()
    assert (reply.client, reply.number, reply.error, reply.body.sum) == (CLIENT, 1, "", 2)


async def test_messages_that_come_before_their_route(world: World) -> None:
    world.serve()
    world.ask()
    world.call(1)
    world.call(2)
    await until(lambda: len(world.here.ways._early) == 2)
    world.read_requests()
    assert len(payloads(world.asked)) == 2
    for payload in payloads(world.asked):
        world.answer(payload)
    await until(lambda: len(world.there.ways._early) == 2)
    reader = world.read_replies()
    assert [reply.body.sum for reply in world.replies()] == [2, 3]
    reader.close()
    world.call(3)
    await until(lambda: len(world.asked) == 3)
    world.answer(payloads(world.asked)[2])
    await until(lambda: len(world.there.ways._early) == 1)
    world.there.ways.endpoint_gone(world.here.shown[0][1])
    assert len(world.there.ways._early) == 0


async def test_an_end_is_there_with_both_endpoints(world: World) -> None:
    side = world.here
    writer = side.publish("replies")
    assert (side.shown, writer.write(one(b"")), writer.is_wanted) == ([], 0, True)
    withdraw = side.subscribe("requests")
    assert (len(side.shown), side.room) == (1, ["replies"])
    withdraw()
    assert side.shown == []
    again = side.subscribe("requests")
    assert len(side.shown) == 1
    writer.close()
    writer.close()
    assert (side.shown, writer.is_wanted) == ([], False)
    again()
    assert side.ways._ends == {}


async def test_two_clients_of_a_node(world: World) -> None:
    side = world.there
    for _ in range(2):
        side.subscribe("replies")
    writers = [side.publish("requests") for _ in range(2)]
    assert len({*side.shown}) == 2
    writers[0].close()
    assert len(side.shown) == 1


async def test_endpoints_of_two_clients_find_each_other(world: World) -> None:
    """The bridge announces them in any order: an end may have endpoints of both clients."""
    side = world.there
    withdraw = [side.subscribe("replies")]
    writers = [side.publish("requests"), side.publish("requests")]
    withdraw.append(side.subscribe("replies"))
    assert len(side.shown) == 2
    writers[0].close()
    withdraw[1]()
    assert len(side.shown) == 1
    assert writers[1].write(one(SUPPORT.encode_request(CLIENT, 1, AddTwoInts.Request()))) == 1
    withdraw[0]()
    writers[1].close()
    assert side.shown == [] and side.ways._ends == {}


async def test_a_client_and_a_server_of_a_node(world: World) -> None:
    side = world.here
    side.subscribe("requests")
    side.publish("requests")
    assert side.shown == []
    side.subscribe("replies")
    side.publish("replies")
    assert len(side.shown) == 2


async def test_endpoints_of_different_types(world: World) -> None:
    side = world.here
    side.ways.announce_subscription(local("subscription", "requests"), TRIGGER.requests)
    with pytest.raises(BridgeError, match="are not of one service"):
        side.publish("replies")
    assert side.shown == []


async def test_a_message_that_is_none(world: World) -> None:
    world.ask()
    assert world.client.write(one(b"\xc0")) == 1
    assert world.client.lost == {"undecodable": 1}


async def test_why_there_is_no_answer_comes_by_any_server(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    world.serve()
    world.ask()
    world.read_replies()
    world.client.write(one(SUPPORT.encode_question(CLIENT, 7)))
    (denial,) = world.replies()
    assert (denial.number, denial.error, denial.body) == (7, "", None)


async def test_why_there_is_no_answer_comes_by_all_servers(world: World) -> None:
    """A client with several servers gives up a call only after each has denied it."""
    world.ask()
    heard: list[Batch] = []
    for gid in (b"1" * 16, b"2" * 16):
        world.there.ways.read(far(gid, "replies"), heard.append)
    world.client.write(one(SUPPORT.encode_question(CLIENT, 7)))
    assert payloads(heard) == [SUPPORT.encode_denial(CLIENT, 7)] * 2


async def test_why_there_is_no_answer_waits_for_a_server(world: World) -> None:
    world.serve()
    world.ask()
    world.client.write(one(SUPPORT.encode_question(CLIENT, 7)))
    world.read_replies()
    (denial,) = world.replies()
    assert (denial.number, denial.error, denial.body) == (7, "", None)


async def test_a_far_endpoint_that_goes_is_named(world: World) -> None:
    world.serve()
    world.ask()
    await until(lambda: world.there.services.vendor_of(world.here.shown[0][0]))
    guids = {*world.here.shown[0]}
    world.withdraw()
    await until(lambda: guids <= {*world.there.gone})


async def test_other_busds_are_not_used() -> None:
    other = Services(DOMAIN, lambda text: None)
    server = other.serve("/add", ADD.type_name, lambda request, cdr: None, b"busd=robot;")
    plain = other.serve("/add", ADD.type_name, lambda request, cdr: None)
    side = Side()
    await until(lambda: side.services.vendor_of(plain.guids[0]))
    assert not side.services.vendor_of(server.guids[0])
    side.close()
    other.close()
