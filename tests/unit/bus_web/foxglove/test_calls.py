"""Services: their announcement to a client, and its calls."""

from typing import Any

import pytest

from bus.errors import ServiceError
from bus.schema import MessageSchema
from bus.srv.example_interfaces import AddTwoInts
from bus.srv.std_srvs import Trigger
from bus.types.classes import service_class
from bus.types.support import type_support
from bus_ros.cdr import codec_of
from bus_web.foxglove import calls as module
from bus_web.foxglove.calls import Calls
from bus_web.foxglove.protocol import Call
from web_world import WebWorld

SETTER: Any = service_class("rcl_interfaces/srv/SetParameters")
REQUEST = codec_of(MessageSchema.of(AddTwoInts.Request))


def request(a: int, b: int) -> memoryview:
    return memoryview(
        b"".join(REQUEST.encode(type_support(AddTwoInts.Request).encode(AddTwoInts.Request(a=a, b=b))))
    )


def add(asked: Any) -> Any:
    if asked.a < 0:
        raise ServiceError("/add", "no negative numbers")
    return AddTwoInts.Response(sum=asked.a + asked.b)


class World(WebWorld):
    def __init__(self, *, may_set: bool = False) -> None:
        super().__init__()
        self.calls = Calls(self.hub, self.formats, self.client, may_set=may_set)

    async def services(self) -> dict[str, int]:
        """Announce the services now. Returns the ids of new services, by name."""
        await self.calls.advertise(self.look())
        return {one["name"]: one["id"] for told in await self.told() for one in told.get("services", ())}


async def test_what_is_told_of_services() -> None:
    world = World()
    world.serve("/adder", "/add", AddTwoInts, add)
    world.serve("/robot", "/robot/set_parameters", SETTER, add)
    world.serve("/robot", "/_hidden", Trigger, add)
    assert await world.services() == {"/add": 1}, "--allow-call is not --allow-set"
    assert await world.services() == {}
    world.remove("/add/_reply")
    await world.calls.advertise(world.look())
    assert await world.told() == [{"op": "unadvertiseServices", "serviceIds": [1]}]
    await world.close()
    world = World(may_set=True)
    world.serve("/robot", "/robot/set_parameters", SETTER, add)
    assert await world.services() == {"/robot/set_parameters": 1}
    await world.close()


async def test_calls() -> None:
    world = World()
    world.serve("/adder", "/add", AddTwoInts, add)
    await world.services()
    for number in (1, 2):
        await world.calls.call(Call(1, number, "cdr", request(number, 5)))
    assert await world.told() == []
    answers = [one for one in world.socket.sent if one[0] == 3]
    assert [int.from_bytes(one[5:9], "little") for one in answers] == [1, 2]
    assert [int.from_bytes(one[-8:], "little") for one in answers] == [6, 7]
    (client,) = world.node.clients["/add"]
    assert not client.is_closed
    world.remove("/add/_request")
    await world.calls.advertise(world.look())
    assert client.is_closed
    await world.close()


@pytest.mark.parametrize(
    ("call", "why"),
    [
        (Call(9, 1, "cdr", request(1, 2)), "there is no service 9"),
        (Call(1, 1, "json", request(1, 2)), "requests must be in cdr, not in 'json'"),
        (Call(1, 1, "cdr", request(-1, 2)), "no negative numbers"),
        (Call(1, 1, "cdr", memoryview(b"\0\1\0\0\1")), ""),
        (Call(2, 1, "cdr", request(1, 2)), "no server exists now"),
    ],
)
async def test_why_there_is_no_answer(call: Call, why: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_APPEAR_S", 0.01)
    world = World()
    world.serve("/adder", "/add", AddTwoInts, add)
    world.serve("/adder", "/gone", AddTwoInts, add)
    del world.node.serving["/gone"]
    await world.services()
    await world.calls.call(call)
    (told,) = await world.told()
    assert (told["op"], told["serviceId"], told["callId"]) == ("serviceCallFailure", call.service_id, 1)
    assert why in told["message"]
    await world.calls.close()
    assert [one.is_closed for some in world.node.clients.values() for one in some].count(False) == 0
    await world.close()
