"""docs/tf2.md: all names in its lists exist, and its lists have all names that exist."""

import re
from importlib import import_module
from pathlib import Path

import pytest

from bus_ros.rclpy.duration import Duration
from bus_tf2 import tf2_ros, tf_transformations
from bus_tf2.messages import message_type
from rows import for_each

TEXT = (Path(__file__).parents[3] / "docs" / "tf2.md").read_text()
MODULES = re.findall(
    r"^\| `(tf\w+(?:\.\w+)*)` \| (.*) \|$", TEXT.partition("## Modules")[2].partition("## Rules")[0], re.M
)


@for_each(("name", "cell"), [row for row in MODULES if row[0] != "tf_transformations"])
def test_a_module(name: str, cell: str) -> None:
    module = import_module(f"bus_tf2.{name}")
    listed = set(re.findall(r"`(\w+)`", cell))
    assert not [one for one in listed if not hasattr(module, one)]
    assert set(module.__all__) - {"__getattr__", "as_list"} == listed


def test_tf_transformations() -> None:
    pytest.importorskip("numpy")
    listed = set(re.findall(r"`(\w+)`", dict(MODULES)["tf_transformations"]))
    assert not [one for one in listed if not hasattr(tf_transformations, one)]
    parts = [import_module(f"bus_tf2.tf_transformations.{name}") for name in tf_transformations._WITH_NUMPY]
    assert {name for part in (tf_transformations, *parts) for name in part.__all__} == listed


def test_what_programs_take_from_it_that_is_not_its_own() -> None:
    """In ROS 2, tf2_ros has these names because it imports them."""
    assert tf2_ros.Duration is Duration
    assert tf2_ros.TransformStamped is message_type("geometry_msgs/msg/TransformStamped")
    assert tf2_ros.TFMessage is message_type("tf2_msgs/msg/TFMessage")
    with pytest.raises(AttributeError, match=r"^module 'tf2_ros' has no attribute 'Nothing'$"):
        _ = tf2_ros.Nothing


def test_every_module() -> None:
    assert len(MODULES) == 13
