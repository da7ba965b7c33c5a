"""Foxglove's protocol as its clients use it: channels, messages, time; mistakes, slow clients, restarts."""

import asyncio
import json
import struct
from collections import defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest

import bus
from bus.schema import support_of
from bus_ros.cdr import codec_of, schema_of_definition
from cli import LISTENER, TALKER, Running, script, wait_for_graph
from cli import bus as bus_verb
from conftest import WAIT_S, Daemon
from programs import EXAMPLES
from rows import for_each

pytest.importorskip("websockets", reason="the server is made of websockets")

from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from foxglove_client import NPM_TOPICS, OLDER, SDK, looking, npm_client
from neighbours import with_limits
from web_clients import CAMERA, Serving, Silent, own_bytes, serving

ROBOT = ("perception", "cognition", "actuation", "monitoring")
TOPICS = {"/camera/image_raw", "/imu/data", "/joint_states", "/cmd_vel", "/cmd_vel_applied", "/health"}
STRING = "std_msgs/msg/String"
MIB = 1 << 20

CLOCK = """
import asyncio, bus
from bus.msg.builtin_interfaces import Time
from bus.types.classes import message_class
Clock = message_class("rosgraph_msgs/msg/Clock")
async def main():
    async with bus.Node("clock") as node:
        publisher = await node.create_publisher(Clock, "/clock", 1)
        print("ready", flush=True)
        for number in range(1_000_000):
            publisher.publish(Clock(clock=Time(sec=100, nanosec=number)))
            await asyncio.sleep(0.01)
bus.run(main())
"""
SERVER = """
import asyncio, bus
from bus.srv.example_interfaces import AddTwoInts
def add(request):
    if request.a < 0:
        raise ValueError("no negative numbers")
    return AddTwoInts.Response(sum=request.a + request.b)
async def main():
    async with bus.Node("arm", namespace="/robot") as node:
        await node.declare_parameter("gain", 1.0)
        await node.declare_parameter("joints.names", ["a", "b"])
        await node.create_service(AddTwoInts, "/add", add)
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""
LATCHED = """
import asyncio, bus
from contextlib import AsyncExitStack
from bus.msg.std_msgs import String
async def main():
    async with AsyncExitStack() as nodes:
        for number in range(12):
            node = await nodes.enter_async_context(bus.Node(f"frame_{number}", rosout=False))
            latched = bus.QoSProfile(1, durability=bus.Durability.TRANSIENT_LOCAL)
            publisher = await node.create_publisher(String, "tf_static", latched)
            publisher.publish(String(data=str(number)))
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""


def text_of(data: bytes) -> str:
    """The text of a std_msgs/msg/String in CDR."""
    return data[8 : 8 + struct.unpack_from("<I", data, 4)[0] - 1].decode()


@pytest.fixture
def robot(daemon: Daemon) -> Iterator[None]:
    """The robot's four layers, on the test's busd."""
    with ExitStack() as layers:
        for layer in ROBOT:
            layers.enter_context(Running((str(EXAMPLES / "robot" / f"{layer}.py"),)))
        wait_for_graph(lambda graph: graph.topics().keys() >= TOPICS and len(graph.matches) > 8)
        yield


async def compare(server: Serving, subprotocol: str) -> dict[str, int]:
    """Compares some messages of each channel with those of a subscription; the number of equal ones."""
    stores = pytest.importorskip("rosbags.typesys", reason="rosbags decodes what is compared")
    published: dict[str, set[bytes]] = defaultdict(set)
    same: dict[str, int] = {}
    examples: dict[str, bytes] = {}
    async with (
        asyncio.timeout(WAIT_S),
        bus.Node("judge", rosout=False) as node,
        connect_async(
            server.foxglove, subprotocols=[Subprotocol(subprotocol)], max_size=None, proxy=None
        ) as socket,
    ):
        channels: dict[str, Any] = {}
        while not channels.keys() >= TOPICS:
            told = json.loads(await socket.recv())
            channels.update({one["topic"]: one for one in told.get("channels", ())})
        codecs: dict[str, Any] = {}
        decoders: dict[str, Any] = {}
        graph = await node.graph()
        for topic in TOPICS:
            one = graph.publishers_of(topic)[0]
            schema = await node.get_schema(one.type_name, one.type_hash)
            codecs[topic] = codec_of(schema)
            decoders[topic] = support_of(schema, raw=False).decode
            profile = bus.QoSProfile(100, reliability=bus.Reliability.BEST_EFFORT)
            await node.create_subscription(schema, topic, profile, published[topic].add, raw=True)
        wanted = [{"id": channels[topic]["id"] + 100, "channelId": channels[topic]["id"]} for topic in TOPICS]
        await socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        numbers = {channels[topic]["id"] + 100: topic for topic in TOPICS}
        while min(same.get(topic, 0) for topic in TOPICS) < 3:
            frame = await socket.recv()
            if isinstance(frame, str):
                continue
            topic, data = numbers[struct.unpack_from("<I", frame, 1)[0]], frame[13:]
            payload = codecs[topic].decode(data)
            values = decoders[topic](payload)
            if payload in published[topic] or any(decoders[topic](one) == values for one in published[topic]):
                same[topic] = same.get(topic, 0) + 1
            examples[topic] = data
    for topic, data in examples.items():
        name, definition = channels[topic]["schemaName"], channels[topic]["schema"]
        codec_of(schema_of_definition(name, definition)).decode(data)
        store = stores.get_typestore(stores.Stores.EMPTY)
        store.register(stores.get_types_from_msg(definition, name))
        assert bytes(store.serialize_cdr(store.deserialize_cdr(data, name), name)) == data
    return same


@pytest.mark.landing
@pytest.mark.parametrize("subprotocol", [SDK, pytest.param(OLDER, marks=pytest.mark.nightly)])
def test_every_channel_of_the_robot(robot: None, subprotocol: str) -> None:
    with serving() as server:
        assert asyncio.run(compare(server, subprotocol)).keys() == TOPICS


def test_the_client_that_foxglove_has_published(robot: None) -> None:
    """@foxglove/ws-protocol gets messages of every channel."""
    with serving() as server:
        lines = npm_client(server, NPM_TOPICS, *TOPICS)
    sizes = {line.split()[0]: int(line.split()[2]) for line in lines}
    assert sizes.keys() == TOPICS
    assert sizes["/camera/image_raw"] > 100_000


NPM_QUESTIONS = """
client.on("open", () => {
  client.getParameters(["/robot/arm.gain"], "gain");
  words.forEach((uri, number) => client.fetchAsset(uri, number));
});
const answers = [], missing = new Set(["gain", ...words.keys()]);
function answer(id, text) {
  if (missing.delete(id)) answers.push(`${id}: ${text}`);
  if (missing.size === 0) { console.log(answers.sort().join("\\n")); process.exit(0); }
}
client.on("parameterValues", ({ id, parameters }) => answer(id, JSON.stringify(parameters)));
client.on("fetchAssetResponse", ({ requestId, data, error }) => {
  answer(requestId, data ? new TextDecoder().decode(data) : error);
});
"""


def test_files_and_parameters_for_the_published_client(
    daemon: Daemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It reads a mesh of a share folder, no other file, and a parameter."""
    meshes = tmp_path / "share" / "arm" / "meshes"
    meshes.mkdir(parents=True)
    (meshes / "hand.dae").write_text("mesh")
    (tmp_path / "secret.dae").write_text("secret")
    marker = tmp_path / "share" / "ament_index" / "resource_index" / "packages" / "arm"
    marker.parent.mkdir(parents=True)
    marker.touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    with script(SERVER), serving() as server:
        wait_for_graph(lambda graph: graph.servers_of("/robot/arm/get_parameters"))
        mesh, outside = "package://arm/meshes/hand.dae", "package://arm/../../secret.dae"
        lines = npm_client(server, NPM_QUESTIONS, mesh, outside)
    assert lines[0] == "0: mesh"
    assert lines[1].startswith("1: ") and "begins with a dot" in lines[1]
    assert lines[2:] == ['gain: [{"name":"/robot/arm.gain","value":1,"type":"float64"}]']


class TestChannels:
    def test_what_a_client_is_told_first(self, daemon: Daemon) -> None:
        with script(TALKER, "0.01"), serving() as server, looking(server) as client, looking(server) as other:
            told = client.listen()
            assert isinstance(told, dict)
            assert (told["op"], told["supportedEncodings"]) == ("serverInfo", ["cdr"])
            assert set(told["capabilities"]) == {
                "connectionGraph",
                "parameters",
                "parametersSubscribe",
                "assets",
            }
            assert str(daemon.path) in told["name"]
            channel = client.channel("/topic")
            assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
            assert (channel["schemaName"], channel["schema"]) == (STRING, "string data\n")
            assert other.hear("serverInfo")["sessionId"] == told["sessionId"]

    def test_they_come_and_go_with_the_graph(self, daemon: Daemon) -> None:
        with serving() as server, looking(server) as client:
            with script(LISTENER):
                channel = client.channel("/topic")
                client.subscribe({7: "/topic"})
                with script(TALKER, "0.01"):
                    number, time_ns, data = client.message()
                    assert (number, text_of(data).startswith("Hello World: ")) == (7, True)
                    assert abs(time_ns - asyncio.run(_now_ns())) < 60e9
            client.hear("unadvertise", lambda told: channel["id"] in told["channelIds"])
            with script(LISTENER):
                assert client.channel("/topic")["id"] != channel["id"]

    def test_nothing_is_subscribed_unless_somebody_looks(self, daemon: Daemon) -> None:
        def subscribers(graph: Any) -> list[str]:
            return [one.node.name for one in graph.subscriptions_of("/topic")]

        with script(TALKER, "0.01"), serving() as server:
            with looking(server) as client, looking(server, OLDER) as other, server.viewer() as viewer:
                client.channel("/topic")
                assert subscribers(wait_for_graph(lambda graph: True)) == []
                client.subscribe({1: "/topic"})
                other.subscribe({1: "/topic"})
                viewer.say("look", topics={"/topic": []})
                client.message()
                other.message()
                viewer.hear("value")
                (name,) = subscribers(wait_for_graph(subscribers))
                assert name.startswith("_bus_web")
                client.say("unsubscribe", subscriptionIds=[1, 2])
                viewer.say("look", topics={})
                other.message()
                assert len(subscribers(wait_for_graph(lambda graph: True))) == 1
            wait_for_graph(lambda graph: not subscribers(graph))

    def test_whoever_looks_later_gets_what_publishers_keep(self, daemon: Daemon) -> None:
        with script(LATCHED), serving() as server, looking(server) as client, looking(server) as other:
            for one in (client, other):
                one.subscribe({1: "/tf_static"})
                texts = {text_of(one.message()[2]) for _ in range(12)}
                assert texts == {str(number) for number in range(12)}

    def test_who_is_connected(self, daemon: Daemon) -> None:
        with script(TALKER, "0.1"), serving() as server, looking(server) as client:
            client.channel("/topic")
            client.say("subscribeConnectionGraph")
            told = client.hear("connectionGraphUpdate")
            assert {"name": "/topic", "publisherIds": ["/minimal_publisher"]} in told["publishedTopics"]
            assert told["subscribedTopics"] == []
            with script(LISTENER):
                told = client.hear("connectionGraphUpdate", lambda told: told["subscribedTopics"])
                assert told["subscribedTopics"] == [
                    {"name": "/topic", "subscriberIds": ["/minimal_subscriber"]}
                ]

    def test_time_where_there_is_a_clock(self, daemon: Daemon) -> None:
        with script(TALKER, "0.01"), serving() as server, looking(server) as client:
            assert "time" not in client.hear("serverInfo")["capabilities"]
            with script(CLOCK):
                client.hear("serverInfo", lambda told: "time" in told["capabilities"])
                client.subscribe({1: "/topic"})
                (first_ns,) = struct.unpack("<Q", client.binary(2))
                assert 100_000_000_000 <= first_ns < 101_000_000_000
                while not first_ns <= client.message()[1] < 101_000_000_000:
                    pass
            client.hear("serverInfo", lambda told: "time" not in told["capabilities"])


async def _now_ns() -> int:
    import time

    return time.time_ns()


class TestGettingIn:
    @for_each(
        ("target", "host", "origin"),
        [
            ("/?token=wrong", None, None),
            ("/", None, None),
            (None, "evil.example.org", None),
            (None, None, "https://evil.example.org"),
            (None, None, "null"),
        ],
    )
    def test_who_is_refused(
        self, daemon: Daemon, target: str | None, host: str | None, origin: str | None
    ) -> None:
        with serving() as server:
            address = server.foxglove if target is None else f"ws://{server.host}:{server.port}{target}"
            for subprotocol in (SDK, OLDER):
                with pytest.raises(InvalidStatus) as caught:
                    _connect(address, subprotocol, host, origin)
                assert caught.value.response.status_code == 403

    def test_the_page_of_foxglove_may_come_with_the_token(self, daemon: Daemon) -> None:
        with (
            serving() as server,
            looking(server, origin=Origin("https://app.foxglove.dev")) as client,
        ):
            client.hear("serverInfo")


def _connect(address: str, subprotocol: str, host: str | None, origin: str | None) -> None:
    import socket
    from urllib.parse import urlsplit

    parts = urlsplit(address)
    assert parts.port is not None
    raw = socket.create_connection((parts.hostname or "", parts.port), timeout=WAIT_S)
    with raw:
        connect(
            address.replace(parts.hostname or "", host or parts.hostname or ""),
            sock=raw,
            subprotocols=[Subprotocol(subprotocol)],
            origin=Origin(origin) if origin is not None else None,
            proxy=None,
        ).close()


class TestMistakes:
    @for_each(
        ("said", "level", "text"),
        [
            (b"", 2, "an empty frame"),
            (b"\x01\x00", 2, "this frame has 2 bytes"),
            (b"\x02" + b"\xff" * 12, 2, "4294967295 bytes"),
            ("{", 2, "not understood"),
            ('{"op":"dance"}', 2, "dance"),
            ('{"op":"subscribe","subscriptions":[{"id":4294967296,"channelId":1}]}', 2, "4294967295"),
            (
                '{"op":"subscribe","subscriptions":[{"id":1,"channelId":4294967295}]}',
                1,
                "no channel 4294967295",
            ),
            (b"\x01\x01\x00\x00\x00data", 2, "--allow-publish"),
            (
                '{"op":"advertise","channels":[{"id":1,"topic":"/a","encoding":"cdr","schemaName":"a/B"}]}',
                2,
                "--allow-publish",
            ),
            ('{"op":"setParameters","parameters":[{"name":"/n.p","value":1}]}', 2, "--allow-set"),
        ],
    )
    def test_are_told_and_the_client_stays(
        self, daemon: Daemon, said: str | bytes, level: int, text: str
    ) -> None:
        with serving() as server, looking(server) as client:
            client.connection.send(said)
            told = client.hear("status")
            assert (told["level"], text in told["message"]) == (level, True), told

    def test_more_subscriptions_than_there_can_be(self, daemon: Daemon) -> None:
        many = [{"id": number, "channelId": number} for number in range(25_000)]
        with script(TALKER, "0.01"), serving() as server, looking(server) as client:
            client.subscribe({1: "/topic"})
            for _ in range(4):
                client.say("subscribe", subscriptions=many)
            told = client.hear("status")
            assert "(and 24999 more)" in told["message"] or "(and 24998 more)" in told["message"]
            assert client.message()[0] == 1

    @with_limits(schema_bytes=1024)
    def test_a_type_that_is_too_long_for_busd(self, daemon: Daemon) -> None:
        """The client gets an error, and all clients still get their messages."""
        long = {"id": 1, "topic": "/long", "encoding": "cdr", "schemaName": "no/msg/Long"}
        long["schema"] = "\n".join(f"int8 a{field}" for field in range(100))
        with script(TALKER, "0.01"), serving("--allow-publish") as server, looking(server) as client:
            client.subscribe({1: "/topic"})
            client.say("advertise", channels=[long])
            text = client.hear("status")["message"]
            assert text.startswith("channel 1 (/long): the schema of no/msg/Long has ")
            assert client.message()[0] == 1
        assert "cut off" not in daemon.log.read_text()

    def test_files_and_services(self, daemon: Daemon) -> None:
        with serving() as server, looking(server) as client:
            client.say("fetchAsset", uri="package://robot/mesh.dae", requestId=5)
            assert client.binary(4).endswith(b"there is no package 'robot' here")
            client.connection.send(b"\x02" + struct.pack("<III", 1, 9, 3) + b"cdr")
            told = client.hear("serviceCallFailure")
            assert (told["serviceId"], told["callId"]) == (1, 9)
            assert "--allow-call" in told["message"]


def test_busd_is_restarted(daemon: Daemon) -> None:
    """The channels stay, and messages continue."""
    with script(TALKER, "0.01"), serving() as server, looking(server) as client:
        client.subscribe({1: "/topic"})
        client.message()
        channel = client.channel("/topic")
        daemon.kill()
        assert "the bus is away" in client.hear("status")["message"]
        daemon.restart()
        client.hear("removeStatus")
        client.message(1)
        assert client.channel("/topic") == channel


def test_parameters_are_read_and_followed(daemon: Daemon) -> None:
    with serving() as server, script(SERVER):
        with looking(server) as early:  # its values are outdated when the next client connects
            early.hear("advertise")
        wait_for_graph(lambda graph: graph.servers_of("/robot/arm/set_parameters"))
        parameters_of_the_arm(server)


def parameters_of_the_arm(server: Serving) -> None:
    with looking(server) as client:
        client.say("getParameters", parameterNames=[], id="all")  # as viewers do first
        told = client.hear("parameterValues")
        values = {one["name"]: one for one in told["parameters"]}
        assert told["id"] == "all"
        assert values["/robot/arm.gain"] == {"name": "/robot/arm.gain", "value": 1.0, "type": "float64"}
        assert values["/robot/arm.joints.names"]["value"] == ["a", "b"]
        client.say("subscribeParameterUpdates", parameterNames=["/robot/arm.gain"])
        wait_for_graph(
            lambda graph: any(
                one.node.name.startswith("_bus_web") for one in graph.subscriptions_of("/parameter_events")
            )
        )
        assert bus_verb("param", "set", "/robot/arm", "gain", "2.5").code == 0
        assert client.hear("parameterValues")["parameters"] == [
            {"name": "/robot/arm.gain", "value": 2.5, "type": "float64"}
        ]
        client.say("setParameters", parameters=[{"name": "/robot/arm.gain", "value": 7}], id="set")
        assert "--allow-set" in client.hear("status")["message"]
        assert client.hear("parameterValues")["parameters"][0]["value"] == 2.5
        client.say("getParameters", parameterNames=["/nobody.x", "nonsense"], id="none")
        assert "'/nobody.x' (and 1 more)" in client.hear("status")["message"]
        assert client.hear("parameterValues")["parameters"] == []


def test_parameters_are_set_where_that_is_allowed(daemon: Daemon) -> None:
    with script(SERVER), serving("--allow-set") as server, looking(server, OLDER) as client:
        client.channel("/parameter_events")
        wait_for_graph(lambda graph: graph.servers_of("/robot/arm/set_parameters"))
        given = [{"name": "/robot/arm.gain", "value": 3}]  # as a browser writes 3.0
        client.say("setParameters", parameters=given, id="x")
        told = client.hear("parameterValues", lambda told: told.get("id") == "x")
        assert told["parameters"] == [{"name": "/robot/arm.gain", "value": 3.0, "type": "float64"}]
        client.say("setParameters", parameters=[{"name": "/robot/arm.gain", "value": "text"}])
        told = client.hear("status")
        assert (told["level"], "/robot/arm.gain was not set: " in told["message"]) == (2, True)


def test_services_are_called_where_that_is_allowed(daemon: Daemon) -> None:
    with script(SERVER), serving("--allow-call") as server, looking(server) as client:
        assert "services" in client.hear("serverInfo")["capabilities"]
        add = client.service("/add")
        assert add["type"] == "example_interfaces/srv/AddTwoInts"
        assert add["request"] == {
            "encoding": "cdr",
            "schemaName": "example_interfaces/srv/AddTwoInts_Request",
            "schemaEncoding": "ros2msg",
            "schema": "int64 a\nint64 b\n",
        }
        assert "/robot/arm/get_parameters" in client.services
        assert "/robot/arm/set_parameters" not in client.services, "that is --allow-set"

        def call(number: int, encoding: bytes, data: bytes) -> None:
            head = struct.pack("<BIII", 2, add["id"], number, len(encoding))
            client.connection.send(head + encoding + data)

        call(8, b"cdr", b"\0\1\0\0" + struct.pack("<qq", 2, 3))
        assert client.binary(3) == (
            struct.pack("<III", add["id"], 8, 3) + b"cdr" + b"\0\1\0\0" + struct.pack("<q", 5)
        )
        for number, encoding, data, text in (
            (9, b"cdr", b"\0\1", "no CDR message"),
            (10, b"json", b"{}", "not in 'json'"),
            (11, b"cdr", b"\0\1\0\0" + struct.pack("<qq", -1, 3), "no negative numbers"),
        ):
            call(number, encoding, data)
            told = client.hear("serviceCallFailure")
            assert (told["callId"], text in told["message"]) == (number, True), told


def test_messages_are_published_where_that_is_allowed(daemon: Daemon) -> None:
    with (
        script(
            LISTENER.replace("lambda message: None", "lambda message: print(message.data, flush=True)")
        ) as listener,
        serving("--allow-publish") as server,
        looking(server) as client,
    ):
        assert "clientPublish" in client.hear("serverInfo")["capabilities"]
        client.channel("/topic")

        def advertise(number: int, topic: str, name: str, **more: Any) -> None:
            one = {"id": number, "topic": topic, "encoding": "cdr", "schemaName": name, **more}
            client.say("advertise", channels=[one])

        def publish(number: int, data: bytes) -> None:
            client.connection.send(b"\x01" + struct.pack("<I", number) + data)

        advertise(3, "/topic", "std_msgs/String")
        wait_for_graph(lambda graph: graph.publishers_of("/topic") and graph.matches)
        publish(3, b"\0\1\0\0" + struct.pack("<I", 6) + b"hello\0")
        assert listener.line() == "hello"
        for number, topic, name, more, text in (
            (3, "/topic", STRING, {}, "a channel of this number"),
            (4, "/topic", "std_msgs/msg/Int32", {}, f"has the type {STRING}"),
            (5, "/add/_request", STRING, {}, "a service is called"),
            (6, "no topic", STRING, {}, "no topic"),
            (7, "/x", "nobody/msg/Knows", {}, "nobody/msg/Knows"),
            (8, "/x", STRING, {"encoding": "json"}, "not in 'json'"),
        ):
            advertise(number, topic, name, **more)
            told = client.hear("status")
            assert (told["level"], text in told["message"]) == (2, True), told
        publish(3, b"\0\1")
        assert "no CDR message" in client.hear("status")["message"]
        publish(99, b"")
        assert "no channel 99" in client.hear("status")["message"]
        advertise(9, "/own", "demo/msg/Own", schema="int32 number\n", schemaEncoding="ros2msg")
        wait_for_graph(lambda graph: graph.publishers_of("/own"))
        client.say("unadvertise", channelIds=[3, 9])
        wait_for_graph(lambda graph: not graph.publishers_of("/own") and not graph.publishers_of("/topic"))


def test_a_client_that_stops_reading(daemon: Daemon) -> None:
    """It costs at most its queue, others get everything, and later it learns how much it has missed."""
    with script(TALKER, "0.005"), script(CAMERA, "0.01"), serving() as server, looking(server) as client:
        client.subscribe({1: "/image", 2: "/topic"})
        ids = {topic: client.channels[topic]["id"] for topic in ("/image", "/topic")}
        for _ in range(60):
            client.message(1)
        before = own_bytes(server.running.process.pid)
        with closing(Silent(server, SDK)) as silent, looking(server) as third:
            third.channel("/topic")
            for number, id in enumerate(ids.values()):
                silent.say("subscribe", subscriptions=[{"id": number, "channelId": id}])
            for _ in range(60):  # of 500 kB each: all of them would be 30 MB
                client.message(1)
            assert own_bytes(server.running.process.pid) - before < 16 * MIB
            silent.wait_for(rb"\d+ messages left out, because this client reads too slowly: /image \d+")
        client.message(1)
