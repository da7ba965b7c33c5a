"""Descriptions of types. The server asks for each only once."""

from unittest.mock import Mock

import pytest

from bus.errors import ConnectionClosed
from bus.msg.std_msgs import String
from bus.schema import schema_of
from bus.types.support import type_support
from bus_web import descriptions as module
from bus_web.descriptions import Descriptions
from web_world import WebWorld

STRING = schema_of(type_support(String))
KIND = STRING.type_name, STRING.type_hash


async def test_asked_for_where_they_are_wanted() -> None:
    world = WebWorld()
    world.node.schemas[KIND] = STRING
    descriptions = Descriptions(world.node)  # type: ignore[arg-type]
    assert not await descriptions.ask()
    assert (descriptions(*KIND), descriptions("a/msg/B", "h")) == (None, None)
    assert await descriptions.ask()
    assert descriptions(*KIND) == STRING.encoded
    assert descriptions("a/msg/B", "h") is None, "no endpoint has it"
    assert not await descriptions.ask(), "it is not asked for again and again"


async def test_while_busd_is_away_they_stay_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    world = WebWorld()
    world.node.schemas[KIND] = STRING
    descriptions = Descriptions(world.node)  # type: ignore[arg-type]
    descriptions(*KIND)
    for fault in (ConnectionClosed("busd has ended"), TimeoutError()):
        with monkeypatch.context() as away:
            away.setattr(world.node, "get_schema", Mock(side_effect=fault))
            assert not await descriptions.ask()
    assert await descriptions.ask()
    assert descriptions(*KIND) == STRING.encoded


async def test_there_is_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST", 2)
    descriptions = Descriptions(WebWorld().node)  # type: ignore[arg-type]
    for number in range(5):
        descriptions(f"a/msg/B{number}", "h")
    assert await descriptions.ask()
    assert len(descriptions._known) == 2
