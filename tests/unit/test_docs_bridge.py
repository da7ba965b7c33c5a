"""docs/bridge.md has the keys, options, examples and reasons of the code."""

import re
from argparse import ArgumentParser
from pathlib import Path

import pytest
from msgspec import structs

from bus.vocabulary import DropReason
from bus_bridge.config import load
from bus_bridge.core.bounds import Bounds
from bus_bridge.core.rules import TopicRule
from bus_bridge.options import BridgeTable, Ros2Table, TlsTable, ZenohTable
from bus_cli.main import make_parser
from claims import DOCS
from rows import for_each

BRIDGE = DOCS.parent / "clients" / "bus_bridge"
PAGE = (DOCS / "bridge.md").read_text()


def keys_in(heading: str) -> set[str]:
    """The names in the first column of the tables of a section."""
    section = PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    cells = re.findall(r"^\| (`.+?) \|", section, re.MULTILINE)
    return {name for cell in cells for name in re.findall(r"`([\w.]+)`", cell)}


def test_every_key_is_there() -> None:
    common = {field.name for field in structs.fields(BridgeTable)}
    tls = {f"tls.{field.name}" for field in structs.fields(TlsTable)}
    zenoh = {field.name for field in structs.fields(ZenohTable)} - common - {"tls"} | tls
    assert keys_in("Rules") == common | {field.name for field in structs.fields(TopicRule)}
    assert keys_in("zenoh") == zenoh
    ros2 = {field.name for field in structs.fields(Ros2Table)} - common - {"tls"} | tls
    on_zenoh = {"rmw", "connect", "router", "listen", "insecure"} | tls
    assert keys_in("ROS 2 on zenoh (rmw_zenoh)") == on_zenoh
    assert keys_in("ROS 2 (DDS)") == ros2 - on_zenoh


@for_each("verb", ["zenoh", "ros2"])
def test_every_option_is_there(verb: str) -> None:
    for option in options_of(verb):
        assert re.search(rf"`{option}\b", PAGE), option


def options_of(verb: str) -> set[str]:
    """The verb's own options, without those of all verbs, and `--log-level`."""

    def leaf(parser: ArgumentParser, *names: str) -> ArgumentParser:
        for name in names:
            (below,) = (action for action in parser._actions if action.choices and not action.option_strings)
            assert isinstance(below.choices, dict)
            parser = below.choices[name]
        return parser

    every, ours = (
        {
            option
            for action in leaf(make_parser(["bridge", one]), "bridge", one)._actions
            for option in action.option_strings
            if option.startswith("--")
        }
        for one in ("status", verb)
    )
    return ours - every - {"--log-level"}


@pytest.mark.parametrize("example", re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL))
def test_examples_are_valid(tmp_path: Path, example: str) -> None:
    file = tmp_path / "busd.toml"
    file.write_text(example)
    assert load(file, ZenohTable) != ZenohTable() or load(file, Ros2Table) != Ros2Table()


def test_limits_are_those_of_the_code() -> None:
    section = PAGE.partition("\n## Limits\n")[2].partition("\n## ")[0]
    shown = [
        int(found.replace(",", ""))
        for found in re.findall(r"\| ([\d,]+)(?: bytes)? \|$", section, re.MULTILINE)
    ]
    assert shown == [*structs.asdict(Bounds()).values()]


def test_every_reason_is_explained() -> None:
    table = PAGE.partition("\n| reason |")[2].partition("\n\n")[0]
    explained = re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)
    sources = "".join(path.read_text() for path in BRIDGE.rglob("*.py"))
    used = {DropReason[name] for name in re.findall(r"\bDropReason\.([A-Z_]+)", sources)}
    assert sorted(explained) == sorted(used)
