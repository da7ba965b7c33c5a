"""Playback of service calls: `--publish-service-requests`."""

import asyncio
from pathlib import Path
from typing import Any, get_type_hints

import pytest

import bus
from bus.schema import MessageSchema
from bus.srv.example_interfaces import AddTwoInts
from bus_bag.play.requests import SOURCES
from bus_ros.rosidl import message_class
from conftest import Daemon
from playing import Sample, replay, write_bag
from semantics import node, until

__all__ = ["node"]

_DEFINITION: Any = message_class("example_interfaces/srv/AddTwoInts_Event")
EVENT: Any = MessageSchema.of(_DEFINITION).to_class()
TOPIC = "/add/_service_event"
SENT, RECEIVED, ANSWERED = 0, 1, 2


def event(kind: int, *, at_ms: float, a: int | None) -> Sample:
    hints = get_type_hints(EVENT)
    info = hints["info"]
    stamp = get_type_hints(info)["stamp"]()
    message = EVENT(
        info=info(event_type=kind, stamp=stamp, client_gid=[0] * 16, sequence_number=1),
        request=[] if a is None else [hints["request"].__args__[0](a=a, b=1)],
        response=[],
    )
    return Sample(TOPIC, at_ms, message)


def bag_of(folder: Path) -> Path:
    """Two calls; those seen by the client have other numbers, to tell them apart."""
    samples = []
    for number in (1, 2):
        begin = 20.0 * number
        samples += [
            event(SENT, at_ms=begin, a=10 * number),
            event(RECEIVED, at_ms=begin + 1, a=number),
            event(ANSWERED, at_ms=begin + 2, a=None),
        ]
    return write_bag(folder / "bag", samples, with_schema=True)


@pytest.fixture
async def asked(daemon: Daemon, node: bus.Node) -> list[int]:
    """The requests that a service has received."""
    found: list[int] = []

    def add(request: Any) -> Any:
        found.append(request.a)
        return AddTwoInts.Response(sum=request.a + request.b)

    await node.create_service(AddTwoInts, "add", add)
    return found


@pytest.mark.parametrize(
    ("source", "expected"), [("service_introspection", [1, 2]), ("client_introspection", [10, 20])]
)
async def test_requests_reach_the_service(
    asked: list[int], node: bus.Node, tmp_path: Path, source: str, expected: list[int]
) -> None:
    assert source in SOURCES
    async with replay(node, bag_of(tmp_path), requests_source=source, acknowledged_within=0) as player:
        await player.task
        assert asked == expected
        assert not (await node.graph()).publishers_of(TOPIC)


async def test_without_the_option_events_are_published(
    asked: list[int], node: bus.Node, tmp_path: Path
) -> None:
    heard: list[int] = []
    await node.create_subscription(EVENT, TOPIC, 100, lambda message: heard.append(message.info.event_type))
    async with replay(node, bag_of(tmp_path)) as player:
        await player.task
    await until(lambda: heard == [SENT, RECEIVED, ANSWERED] * 2)
    assert asked == []


async def test_the_last_request_arrives_after_the_player(
    asked: list[int], node: bus.Node, tmp_path: Path
) -> None:
    async with replay(node, bag_of(tmp_path), requests_source="service_introspection") as player:
        await player.task
    await until(lambda: asked == [1, 2])


async def test_events_without_contents(
    asked: list[int], node: bus.Node, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "bag", [event(RECEIVED, at_ms=5.0 * number, a=None) for number in range(3)])
    async with replay(node, bag, requests_source="service_introspection") as player:
        await player.task
    warning = "The configuration of introspection for '/add' was metadata only on service side!"
    assert capfd.readouterr().err.count(warning) == 1
    assert asked == []


async def test_no_service(
    daemon: Daemon, node: bus.Node, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    async with replay(node, bag_of(tmp_path), requests_source="service_introspection") as player:
        await asyncio.wait_for(player.task, 30)
    text = "Service request hasn't been sent. The '/add' service isn't ready !"
    assert capfd.readouterr().err.count(text) == 2
