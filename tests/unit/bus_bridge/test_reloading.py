"""bus_bridge.reloading: new rules of a running bridge, and mistakes in them."""

from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from bus.errors import ConfigurationError
from bus_bridge.core.naming import Naming
from bus_bridge.core.rules import Rules, TopicRule
from bus_bridge.options import BridgeTable, Ros2Table
from bus_bridge.reloading import Reloading, Source
from rows import for_each

FIRST = Ros2Table(namespace="/bot", deny=("/secret",))
_FILE = Path("/etc/busd.toml")


class Log:
    def __init__(self) -> None:
        self.lines: list[str] = []

    def info(self, text: str) -> None:
        self.lines.append(f"info: {text}")

    def error(self, text: str) -> None:
        self.lines.append(f"error: {text}")


class World:
    """A bridge whose file is `table`."""

    def __init__(self, *, has_file: bool = True) -> None:
        self.table: BridgeTable | Exception = FIRST
        self.applied: list[tuple[Rules, Naming]] = []
        self.log = Log()
        source = Source(_FILE, self._load) if has_file else None
        log: Any = self.log
        self.reloading = Reloading("ros2", FIRST, source, lambda *both: self.applied.append(both), log)

    def _load(self) -> BridgeTable:
        if isinstance(self.table, Exception):
            raise self.table
        return self.table

    def reload(self, table: BridgeTable | Exception) -> str:
        """The new line of the log."""
        self.table = table
        self.reloading.reload()
        (line,) = self.log.lines
        self.log.lines.clear()
        return line


@pytest.fixture
def world() -> World:
    return World()


@for_each(
    ("changes", "said", "is_applied"),
    [
        ({}, "no rule has changed", False),
        ({"allow": ("/a",), "deny": ()}, "changed: allow, deny", True),
        ({"topics": (TopicRule(pattern="/a", far_name="/b"),)}, "changed: topics", True),
        (
            {"allow": ("/a",), "interface": "eth0", "namespace": "/new"},
            "changed: allow; changes of namespace, interface apply when the bridge starts again",
            True,
        ),
        ({"id": "x"}, "no rule has changed; changes of id apply when the bridge starts again", False),
    ],
)
def test_changes(changes: dict[str, Any], said: str, is_applied: bool) -> None:
    world = World()
    assert world.reload(structs.replace(FIRST, **changes)) == f"info: reloaded {_FILE}: {said}"
    assert len(world.applied) == is_applied


def test_the_rules_and_names_of_the_file_apply_with_the_namespace_of_the_start(world: World) -> None:
    world.reload(Ros2Table(namespace="/new", topics=(TopicRule(pattern="/a", far_name="/b"),)))
    ((rules, naming),) = world.applied
    assert rules.crossing("/secret").goes_out
    assert (naming.topic_to_wire("/a"), naming.topic_to_wire("/c")) == ("/b", "/bot/c")


@for_each(
    ("table", "said"),
    [
        (ConfigurationError(f"{_FILE}: not valid TOML"), f"{_FILE}: not valid TOML"),
        (ConfigurationError("one\n  two"), "one two"),
        (
            Ros2Table(topics=(TopicRule(pattern="/a/*", far_name="/b"),)),
            "bridge.ros2.topics.far_name = '/b': its pattern must be one name, without wildcards",
        ),
    ],
)
def test_a_mistake_changes_nothing(table: Any, said: str) -> None:
    world = World()
    assert world.reload(table) == f"error: the rules stay as they were: {said}"
    assert world.applied == []
    assert world.reload(FIRST) == f"info: reloaded {_FILE}: no rule has changed"


def test_without_a_file() -> None:
    world = World(has_file=False)
    assert "SIGHUP has no effect: the bridge has no file" in world.reload(FIRST)
