"""bus_cli.stream: the class for a topic's messages. The topic's endpoints may go at any moment."""

import asyncio
from types import SimpleNamespace
from typing import Any, cast

from bus.errors import ConfigurationError
from bus.graph import Graph
from bus.msg.std_msgs import String
from bus.node import Node
from bus.schema import MessageSchema
from bus_cli.stream import find_class

OURS = MessageSchema.of(String)
KINDS = [("std_msgs/msg/String", "one that has gone"), (OURS.type_name, OURS.type_hash)]


class Bus:
    """A node. Its busd knows only the types of `present`."""

    def __init__(self, *present: tuple[str, str], schema: MessageSchema = OURS) -> None:
        self.present = present
        self.schema = schema

    async def get_schema(self, *kind: str) -> MessageSchema:
        if kind not in self.present:
            raise ConfigurationError(f"no endpoint has the type {kind}")
        return self.schema


def found(
    present: list[tuple[str, str]],
    shown: list[tuple[str, str]],
    type_name: str | None = None,
    schema: MessageSchema = OURS,
) -> Any:
    """The class found for a topic if the graph has shown endpoints of the types `shown`."""
    ends = [SimpleNamespace(topic="/topic", type_name=name, type_hash=number) for name, number in shown]
    graph = cast("Graph", SimpleNamespace(publishers=ends, subscriptions=[]))
    return asyncio.run(find_class(cast("Node", Bus(*present, schema=schema)), graph, "/topic", type_name))


def test_a_type_that_has_gone_meanwhile() -> None:
    assert found([], KINDS[:1]) is None
    assert found([], KINDS[:1], "std_msgs/msg/String") is String
    assert found(KINDS[1:], KINDS, "std_msgs/msg/String") is String


def test_a_type_that_is_there() -> None:
    assert found(KINDS[1:], KINDS[1:]) is String
    assert found(KINDS[1:], KINDS[1:], "std_msgs/msg/String") is String


def test_a_type_that_this_machine_does_not_know_is_made_from_its_schema() -> None:
    description = OURS.description
    types = {"arm/msg/Grip": description["types"][description["root"]]}
    schema = MessageSchema.of({"root": "arm/msg/Grip", "types": types})
    kinds = [(schema.type_name, schema.type_hash)]
    for name in (None, "arm/msg/Grip"):
        made = found(kinds, kinds, name, schema)
        assert made is not String
        assert made(data="closed").data == "closed"
