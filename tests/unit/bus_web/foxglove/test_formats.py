"""Announced types: in the form of ROS 2."""

from bus.msg.std_msgs import String
from bus.schema import MessageSchema, schema_of
from bus.srv.example_interfaces import AddTwoInts
from bus.types.support import type_support
from bus_ros.cdr import Codec
from bus_web.foxglove.formats import describe_channel
from web_world import WebWorld

STRING = schema_of(type_support(String))
KIND = STRING.type_name, STRING.type_hash


async def test_the_codec_of_a_type_is_asked_for_once() -> None:
    world = WebWorld()
    formats = world.formats
    assert await formats.find(KIND) is None, "nobody has it just now"
    world.node.schemas[KIND] = STRING
    codec = await formats.find(KIND)
    assert isinstance(codec, Codec)
    world.node.schemas.clear()
    assert await formats.find(KIND) is codec
    assert describe_channel(3, "/x", codec) == {
        "id": 3, "topic": "/x", "encoding": "cdr", "schemaName": "std_msgs/msg/String",
        "schemaEncoding": "ros2msg", "schema": codec.definition,
    }  # fmt: skip


async def test_a_description_that_makes_no_sense_says_why() -> None:
    world = WebWorld()
    world.node.schemas["a/msg/B", "h"] = MessageSchema("a/msg/B", "h", b"\xc1")
    found = await world.formats.find(("a/msg/B", "h"))
    assert isinstance(found, str)
    assert found != ""


async def test_services() -> None:
    world = WebWorld()
    world.serve("/adder", "/add", AddTwoInts, lambda request: None)
    graph = world.look()
    (server,), (replies,) = graph.servers_of("/add"), graph.publishers_of("/add/_reply")
    kinds = (server.type_name, server.type_hash), (replies.type_name, replies.type_hash)
    formats = world.formats
    found = await formats.find_service(*kinds)
    assert found is not None
    told = found.describe(7, "/add")
    assert (told["id"], told["name"], told["type"]) == (7, "/add", "example_interfaces/srv/AddTwoInts")
    assert told["request"]["schema"] == told["requestSchema"] == "int64 a\nint64 b\n"
    assert told["response"]["schemaEncoding"] == "ros2msg"
    request = b"".join(
        found.request.encode(type_support(AddTwoInts.Request).encode(AddTwoInts.Request(a=1, b=2)))
    )
    read = found.read_request(request)
    assert (read.a, read.b) == (1, 2)
    answer = b"".join(found.write_response(found.definition.Response(sum=3)))
    assert found.response.decode(answer) == type_support(AddTwoInts.Response).encode(
        AddTwoInts.Response(sum=3)
    )
    world.node.schemas.clear()
    assert await formats.find_service(*kinds) is found
    assert await formats.find_service(KIND, KIND) is None, "no service's types"
