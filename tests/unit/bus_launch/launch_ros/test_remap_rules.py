"""bus_launch.launch_ros.remap_rules: pairs of names, and what is none."""

from typing import Any

import pytest

from bus_launch.launch.core import LaunchContext, TextSubstitution, perform_substitutions
from bus_launch.launch_ros.remap_rules import normalize_remap_rule, normalize_remap_rules
from rows import for_each


def test_rules() -> None:
    rules = [("ping", "pong"), (("a", "b"), ["c", TextSubstitution(text="d")])]
    found = [
        [perform_substitutions(LaunchContext(), side) for side in rule]
        for rule in normalize_remap_rules(rules)
    ]
    assert found == [["ping", "pong"], ["ab", "cd"]]


@for_each("rule", ["foo", ("foo",), ("a", "b", "c"), ["a", "b"], 5])
def test_what_is_no_rule(rule: Any) -> None:
    with pytest.raises(TypeError, match="a remap rule is a tuple"):
        normalize_remap_rule(rule)


def test_a_dict_has_no_rules() -> None:
    with pytest.raises(TypeError, match="remappings are a list of tuples"):
        normalize_remap_rules({"a": "b"})
