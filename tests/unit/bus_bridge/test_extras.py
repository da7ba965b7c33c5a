"""bus_bridge.extras: the error if a package is missing."""

import pytest

from bus_bridge import extras
from rows import for_each

X86, ARM = "x86_64", "aarch64"
FASTER = "a bridge to ros2 is faster with cyclonedds"


@pytest.fixture
def nothing_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda name: None)


@for_each(
    ("engine", "machine", "python", "said"),
    [
        (
            "zenoh",
            X86,
            (3, 11),
            "a bridge to zenoh needs eclipse-zenoh: pip install 'eclipse-zenoh>=1.10,<2'",
        ),
        (
            "zenoh",
            ARM,
            (3, 14),
            "a bridge to zenoh needs eclipse-zenoh: pip install 'eclipse-zenoh>=1.10,<2'",
        ),
        (
            "ros2",
            X86,
            (3, 13),
            f"{FASTER}: pip install 'cyclonedds>=11.0.1'",
        ),
        (
            "ros2",
            ARM,
            (3, 11),
            f"{FASTER}, of which there is no package for aarch64, only for x86_64",
        ),
        (
            "ros2",
            X86,
            (3, 14),
            f"{FASTER}, of which there is no package for Python 3.14 yet: use 3.13 or older",
        ),
    ],
)
def test_what_to_do(
    nothing_is_there: None, engine: str, machine: str, python: tuple[int, int], said: str
) -> None:
    assert extras.why_missing(engine, machine, python) == said


def test_nothing_is_said_where_it_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda name: object())
    assert [extras.why_missing(engine) for engine in extras.EXTRAS] == ["", ""]


def test_ros_2_on_zenoh(nothing_is_there: None, monkeypatch: pytest.MonkeyPatch) -> None:
    needs = "a bridge to ROS 2 on zenoh needs"
    zenoh, xxhash = "'eclipse-zenoh>=1.10,<2'", "'xxhash>=3,<5'"
    assert extras.why_no_rmw_zenoh() == f"{needs} eclipse-zenoh and xxhash: pip install {zenoh} {xxhash}"
    monkeypatch.setattr(extras, "find_spec", lambda name: None if name == "xxhash" else object())
    assert extras.why_no_rmw_zenoh() == f"{needs} xxhash: pip install {xxhash}"
    monkeypatch.setattr(extras, "find_spec", lambda name: object())
    assert extras.why_no_rmw_zenoh() == ""
