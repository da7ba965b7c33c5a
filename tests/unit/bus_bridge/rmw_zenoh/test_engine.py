"""bus_bridge.rmw_zenoh.engine: with another session of zenoh on loopback."""

from typing import Any
from unittest.mock import Mock

import pytest

from bridged_world import until
from ports import free_port

pytest.importorskip("zenoh", reason="needs the extra rmw-zenoh: make setup installs it")
pytest.importorskip("xxhash", reason="needs the extra rmw-zenoh: make setup installs it")

from bus_bridge.rmw_zenoh import engine as module
from bus_bridge.rmw_zenoh.engine import RmwZenohEngine
from bus_bridge.rmw_zenoh.options import RmwZenohOptions
from bus_bridge.rmw_zenoh.session import RosSession
from bus_bridge.zenoh.options import ZenohOptions
from rmw_zenoh_sessions import zenoh_runs

__all__ = ["zenoh_runs"]


async def test_after_lost_news_the_graph_is_that_of_the_present_tokens(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "_LOOK_S", 0.05)
    place = f"tcp/127.0.0.1:{free_port()}"
    faults: list[Any] = []
    far: Any = Mock()
    names: set[str] = set()
    far.node_added = lambda node: names.add(node.name)
    far.node_removed = lambda key: names.remove(key.rpartition("/")[2])
    engine = RmwZenohEngine("robot", RmwZenohOptions(ZenohOptions(listen=(place,)), 0))
    other = RosSession(ZenohOptions(connect=(place,)), faults.append)
    await engine.open(far)
    await other.open()
    try:
        there = other.token(f"@ros2_lv/0/{other.zenoh_id}/0/0/NN/%/%/there")
        await until(lambda: names == {"there"})
        engine._see_token((f"@ros2_lv/0/{other.zenoh_id}/1/1/NN/%/%/gone", True))
        assert names == {"there", "gone"}
        engine._lose_token((f"@ros2_lv/0/{other.zenoh_id}/1/1/NN/%/%/gone", False))
        await until(lambda: far.warn.called and names == {"there"}, lambda: str(names))
        far.warn.assert_called_once_with(
            "ROS 2 announced more than the bridge could read at once: it asks again"
        )
        there.undeclare()
        await until(lambda: not names)
    finally:
        await other.close()
        await engine.close()
    assert faults == []
