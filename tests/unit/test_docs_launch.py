"""docs/launch.md lists all modules with their names, tags, and substitutions."""

import re
from importlib import import_module
from pathlib import Path

import bus_ros.import_hook  # noqa: F401 (the page has ROS 2's names)
from bus_launch.launch.frontend import Parser, expose

PAGE = (Path(__file__).parents[2] / "docs" / "launch.md").read_text()
ROWS = re.findall(r"^\| `(launch[a-z_.]*)` \| (`.*`) \|$", PAGE, re.MULTILINE)
WITHIN = {"choice", "composable_node", "env", "extra_arg", "keep", "param", "remap"}


def test_modules_and_names() -> None:
    assert len(ROWS) > 20
    for module, names in ROWS:
        found = import_module(module)
        for name in re.findall(r"`(\w+)`", names):
            assert hasattr(found, name), (module, name)


def test_all_actions_and_substitutions_are_listed() -> None:
    listed = {module: set(re.findall(r"`(\w+)`", names)) for module, names in ROWS}
    for module in (
        "launch.actions",
        "launch.substitutions",
        "launch_ros.actions",
        "launch_ros.substitutions",
    ):
        assert listed[module] | {"Action"} >= set(import_module(module).__all__), module


def test_tags_and_substitutions() -> None:
    Parser.load_launch_extensions()
    tags = set(re.findall(r"`<([a-z_]+)>`", PAGE))
    refused = {"ready_to_test"}
    others = {"push-ros-namespace", "ros_timer", "unset_launch_configuration"}
    assert tags - WITHIN == set(expose._actions) - refused - others - {"my_tag"}
    substitutions = set(re.findall(r"`\$\(([a-z_-]+)[^`]*\)`", PAGE))
    assert substitutions == set(expose._substitutions) - {"optenv", "launch_log_dir"}
