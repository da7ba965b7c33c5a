"""Parameters of nodes, read and set by the nodes' services."""

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest

from bus.names import request_topic
from bus.parameters.messages import SERVICES, python_value, value_message
from bus.parameters.values import ParameterType
from bus.types.classes import message_class, service_class
from bus_web.foxglove import parameters as module
from bus_web.foxglove.parameters import Parameters
from bus_web.foxglove.protocol import GetParameters, Parameter, SetParameters
from web_world import WebWorld


def interface(name: str) -> Any:
    return message_class(f"rcl_interfaces/msg/{name}")


def value(one: Any) -> Any:
    if one is None:
        return interface("ParameterValue")()
    kind = {float: ParameterType.DOUBLE, int: ParameterType.INTEGER, str: ParameterType.STRING}[type(one)]
    return value_message(interface, kind, one)


class Node:
    """The services of a node for its parameters."""

    def __init__(self, world: WebWorld, node: str, **values: Any) -> None:
        self.values = values
        for kind in ("ListParameters", "GetParameters", "GetParameterTypes", "SetParameters"):
            definition: Any = service_class(f"rcl_interfaces/srv/{kind}")
            answer = partial(self.answer, definition, getattr(self, kind))
            world.serve(node, f"{node}/{SERVICES[kind]}", definition, answer)

    def answer(self, definition: Any, fields: Callable[[Any], dict[str, Any]], asked: Any) -> Any:
        return definition.Response(**fields(asked))

    def ListParameters(self, asked: Any) -> dict[str, Any]:
        return {"result": interface("ListParametersResult")(names=[*self.values])}

    def GetParameters(self, asked: Any) -> dict[str, Any]:
        return {"values": [value(self.values.get(name)) for name in asked.names]}

    def GetParameterTypes(self, asked: Any) -> dict[str, Any]:
        return {"types": [value(self.values.get(name)).type for name in asked.names]}

    def SetParameters(self, asked: Any) -> dict[str, Any]:
        results = []
        for one in asked.parameters:
            is_known = one.name in self.values
            if is_known:
                self.values[one.name] = python_value(one.value)
            result = interface("SetParametersResult")
            results.append(result(successful=is_known, reason="" if is_known else "not declared"))
        return {"results": results}


class World(WebWorld):
    def __init__(self) -> None:
        super().__init__()
        self.parameters = Parameters(self.hub, self.client)
        self.arm = Node(self, "/robot/arm", gain=1.5, name="left")
        self.base = Node(self, "/base", speed=3)
        self.look()


async def test_those_of_all_nodes_and_of_some() -> None:
    world = World()
    await world.parameters.get(GetParameters([], "all"))
    (told,) = await world.told()
    assert told == {
        "op": "parameterValues",
        "id": "all",
        "parameters": [
            {"name": "/base.speed", "value": 3},
            {"name": "/robot/arm.gain", "value": 1.5, "type": "float64"},
            {"name": "/robot/arm.name", "value": "left"},
        ],
    }
    assert all(one.is_closed for some in world.node.clients.values() for one in some)
    await world.parameters.get(GetParameters(["/base.speed", "/nobody.x", "speed"]))
    warning, told = await world.told()
    assert warning["message"] == "no node has the parameter '/nobody.x' (and 1 more)"
    assert told["parameters"] == [{"name": "/base.speed", "value": 3}]
    assert "id" not in told
    await world.close()


async def test_setting_tells_what_was_refused_and_what_holds_now() -> None:
    world = World()
    given = [Parameter("/robot/arm.gain", 2), Parameter("/robot/arm.mass", 1), Parameter("/base.speed", 4)]
    await world.parameters.set(SetParameters(given, "q"))
    refused, told = await world.told()
    assert refused["message"] == "/robot/arm.mass was not set: not declared"
    assert {one["name"]: one.get("value") for one in told["parameters"]} == {
        "/robot/arm.gain": 2.0,
        "/robot/arm.mass": None,
        "/base.speed": 4,
    }
    assert isinstance(world.arm.values["gain"], float), "browsers write 2.0 as 2"
    await world.parameters.set(SetParameters([Parameter("/base.speed", {})]))
    (wrong,) = await world.told()
    assert wrong["message"] == "/base.speed: {} is not a parameter value"
    await world.parameters.set(SetParameters([Parameter(f"/base.x{number}", 1) for number in range(1000)]))
    (all_refused,) = await world.told()
    assert all_refused["message"] == "/base.x0 was not set: not declared (and 999 more)"
    assert world.base.values == {"speed": 4}
    await world.close()


async def test_one_that_does_not_answer_keeps_nobody_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_ANSWER_S", 0.05)
    world = World()
    del world.node.serving["/base/list_parameters"]
    await world.parameters.get(GetParameters([], "all"))
    warning, told = await world.told()
    assert warning["message"] == "parameters of /base: no answer within 0.05 s"
    assert [one["name"] for one in told["parameters"]] == ["/robot/arm.gain", "/robot/arm.name"]
    await world.close()


async def test_nodes_without_parameters_are_not_asked() -> None:
    world = World()
    world.remove(request_topic("/base/list_parameters"))
    world.look()
    await world.parameters.get(GetParameters([]))
    (told,) = await world.told()
    assert [one["name"] for one in told["parameters"]] == ["/robot/arm.gain", "/robot/arm.name"]
    await world.close()


async def test_following() -> None:
    world, parameters = World(), Parameters(World().hub, (other := WebWorld()).client)
    make, event = interface("Parameter"), interface("ParameterEvent")
    changed = event(
        node="/base",
        new_parameters=[make(name="a", value=value(1))],
        changed_parameters=[make(name="b", value=value(2))],
        deleted_parameters=[make(name="c")],
    )
    heard: Any = SimpleNamespace(message=changed)
    assert not parameters.is_following
    parameters.on_event(heard)
    parameters.follow(["/base.b", "/base.c"])
    assert parameters.is_following
    parameters.on_event(heard)
    parameters.unfollow(["/base.b", "/base.c"])
    parameters.on_event(heard)
    parameters.follow([])
    parameters.on_event(heard)
    parameters.on_event(SimpleNamespace(message=None))  # type: ignore[arg-type]
    parameters.unfollow([])
    assert not parameters.is_following
    some, every = await other.told()
    assert some["parameters"] == [{"name": "/base.b", "value": 2}, {"name": "/base.c"}]
    assert [one["name"] for one in every["parameters"]] == ["/base.a", "/base.b", "/base.c"]
    for one in (world, other):
        await one.close()
