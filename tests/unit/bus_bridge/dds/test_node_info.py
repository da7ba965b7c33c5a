"""Writers of `ros_discovery_info` that send nothing."""

import asyncio
from unittest.mock import Mock

import pytest

from bus_bridge.dds import node_info
from bus_bridge.dds.node_info import NodeInfo
from semantics import until


async def test_a_writer_that_never_sends_is_probed_for_a_while_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each probe makes a reader, to which all participants send their nodes again."""
    monkeypatch.setattr(node_info, "_PROBE_AFTER_S", 0.0)
    monkeypatch.setattr(node_info, "_PROBE_AGAIN_S", 0.001)
    made: list[Mock] = []

    def make_reader(size: int, on_data: object) -> Mock:
        made.append(Mock())
        return made[-1]

    monkeypatch.setattr(node_info, "NodeTopic", lambda *_: Mock(make_reader=make_reader))
    monkeypatch.setattr(node_info, "NodeWriter", lambda *_: Mock(size=16))
    info = NodeInfo(Mock(), "auto", {}, list, Mock(), Mock())
    info.writer_added(1, b"p" * 16, is_humble=False)
    await until(lambda: info._timer is None)
    first = len(made)
    assert 2 < first < 30 and all(probe.close.call_count == 1 for probe in made[1:])
    info.writer_added(2, b"q" * 16, is_humble=False)
    await until(lambda: len(made) > first)
    info.close()
    await asyncio.sleep(0)
