"""bus_bridge.dds.discovery: endpoints that can't be shown yet."""

import itertools
from unittest.mock import Mock

import pytest

from bus_bridge.dds import discovery as module
from bus_bridge.dds.carrier import Discovered
from bus_bridge.dds.discovery import Discovery
from bus_bridge.dds.qos import Policies
from bus_bridge.errors import BridgeError

_numbers = itertools.count(1)


def endpoint(topic: str = "rt/topic") -> Discovered:
    """A discovered endpoint of an unknown type."""
    number = next(_numbers)
    gid = number.to_bytes(16, "big")
    return Discovered(number, bytes(16), "publisher", gid, topic, "no::msg::dds_::Such_", Policies(), {})


async def test_endpoints_of_unknown_types_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_UNKNOWN", 5)
    types, far = Mock(), Mock()
    types.find.side_effect = BridgeError("no definition")
    discovery = Discovery(Mock(), types, Mock(), far, lambda: None)
    monkeypatch.setattr(discovery, "_report", lambda news: None)
    came = [endpoint() for _ in range(8)]
    for one in came:
        discovery.endpoint_added(one)
    assert [*discovery._unknown] == [one.gid for one in came[:5]]
    assert any(
        "endpoints of ROS 2 have types that are not known" in call.args[0] for call in far.warn.call_args_list
    )
    discovery.types_changed()
    assert len(discovery._unknown) == 5
    for one in came:
        discovery.endpoint_removed(one.gid, one.handle)
    assert not discovery._unknown
