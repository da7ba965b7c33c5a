"""bus_bridge.dds.discovery: endpoints that can't be shown yet."""

import itertools
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

pytest.importorskip("cyclonedds")

from bus_bridge.dds import discovery as module
from bus_bridge.dds.discovery import Discovery
from bus_bridge.errors import BridgeError

_gids = itertools.count(1)


def sample(topic: str = "rt/topic") -> Any:
    """A discovered endpoint of an unknown type."""
    key = SimpleNamespace(bytes=next(_gids).to_bytes(16, "big"))
    return SimpleNamespace(topic_name=topic, type_name="no::msg::dds_::Such_", key=key, qos=())


async def test_endpoints_of_unknown_types_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST_UNKNOWN", 5)
    monkeypatch.setattr(module, "user_data_in", lambda qos: b"")
    types, far = Mock(), Mock()
    types.find.side_effect = BridgeError("no definition")
    discovery = Discovery(Mock(), Mock(), types, Mock(), far, lambda: None)
    monkeypatch.setattr(discovery, "_report", lambda news: None)
    came = [sample() for _ in range(8)]
    for handle, one in enumerate(came):
        discovery._endpoint_added(handle, bytes(16), one, "publisher")
    assert [*discovery._unknown] == [one.key.bytes for one in came[:5]]
    assert any("more than 5 endpoints" in call.args[0] for call in far.warn.call_args_list)
    discovery.types_changed()
    assert len(discovery._unknown) == 5
    for handle, one in enumerate(came):
        discovery._endpoint_removed(one.key.bytes, handle)
    assert not discovery._unknown
