import re
from pathlib import Path

from bus_bridge.core.bus_id import find_bus_id, make_id
from bus_bridge.labels import checked_id
from rows import for_each

_ONE = ("robot", "boot", 1, 2, "busd.sock")


def test_the_id_says_which_host_and_stays_the_same() -> None:
    assert re.fullmatch(r"robot-[0-9a-f]{8}", make_id(*_ONE))
    assert make_id(*_ONE) == make_id(*_ONE)


@for_each(
    "other",
    [
        ("laptop", "boot", 1, 2, "busd.sock"),
        ("robot", "boot2", 1, 2, "busd.sock"),
        ("robot", "boot", 2, 2, "busd.sock"),
        ("robot", "boot", 1, 3, "busd.sock"),
        ("robot", "boot", 1, 2, "0.sock"),
    ],
)
def test_other_buses_have_other_ids(other: tuple[str, str, int, int, str]) -> None:
    assert make_id(*other) != make_id(*_ONE)


@for_each(
    "host, name",
    [
        ("robot.example.org", "robot"),
        ("my_robot", "my-robot"),
        ("-a-", "a"),
        ("", "host"),
        ("...", "host"),
        ("a" * 60, "a" * 40),
    ],
)
def test_hosts(host: str, name: str) -> None:
    found = make_id(host, "boot", 1, 2, "busd.sock")
    assert found[:-9] == name
    assert checked_id(found) == found


def test_this_machine(tmp_path: Path) -> None:
    here = find_bus_id(str(tmp_path / "busd.sock"))
    assert here == find_bus_id(str(tmp_path / "busd.sock"))
    assert here != find_bus_id(str(tmp_path / "other.sock"))
    (tmp_path / "deeper").mkdir()
    assert here != find_bus_id(str(tmp_path / "deeper" / "busd.sock"))
