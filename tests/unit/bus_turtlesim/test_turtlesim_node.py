"""The services of turtlesim, without a bus."""

from typing import Any
from unittest.mock import Mock

import pytest

from bus.errors import ConfigurationError
from bus_turtlesim import turtlesim_node
from bus_turtlesim.messages import Kill, Spawn
from bus_turtlesim.turtlesim_node import TurtleSim
from bus_turtlesim.world import World


def test_a_turtle_whose_services_are_refused_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its topics may have allowed names, and the longer names of its services not."""
    sim: Any = object.__new__(TurtleSim)
    sim.world, sim._endpoints = World(), {}
    sim.get_logger = Mock()
    sim.get_clock = Mock(return_value=Mock(now=Mock(return_value=Mock(nanoseconds=0))))
    name = "b" * 210
    refused = ConfigurationError("the name is too long")
    monkeypatch.setattr(turtlesim_node, "TurtleEndpoints", Mock(side_effect=refused))
    assert sim._serve_spawn(Spawn.Request(name=name), Spawn.Response()).name == ""
    assert not sim.world.turtles
    sim._kill(Kill.Request(name=name), Kill.Response())
    texts = [call.args[0] for call in sim.get_logger().error.call_args_list]
    assert texts == [
        f"Can't spawn a turtle named [{name}]: the name is too long",
        f"Tried to kill turtle [{name}], which does not exist",
    ]
