"""Data from ROS 2 on zenoh before it is on the bus: tokens, and attachments. Without zenoh."""

from hashlib import sha256
from typing import Any
from unittest.mock import patch

from bus_bridge.engine import FarBus, FarEndpoint, FarNode
from bus_bridge.rmw_zenoh import attachment, graph
from bus_bridge.rmw_zenoh.graph import RosGraph, announcer_of
from bus_bridge.ros2.known_types import KnownTypes
from bus_bridge.ros2.service_types import KnownServices
from fuzz.script import Script

_MOST = 8
_STRING = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
_TRIGGER = KnownServices().find("std_srvs/srv/Trigger").type_hash
_TYPES, _SERVICES = KnownTypes(), KnownServices()


class _Far:
    """The receiver of news; see bus_bridge.engine.FarSide. Each must be about an existing object."""

    def __init__(self) -> None:
        self.nodes: set[str] = set()
        self.endpoints: dict[bytes, str] = {}

    def bus_added(self, bus: FarBus) -> None: ...
    def bus_removed(self, bus_id: str, reason: str) -> None: ...

    def node_added(self, node: FarNode) -> None:
        assert node.key not in self.nodes
        self.nodes.add(node.key)

    def node_removed(self, key: str) -> None:
        assert key not in self.endpoints.values()
        self.nodes.remove(key)

    def endpoint_added(self, endpoint: FarEndpoint) -> None:
        assert endpoint.node in self.nodes
        assert endpoint.gid not in self.endpoints
        self.endpoints[endpoint.gid] = endpoint.node

    def endpoint_removed(self, gid: bytes, node: str) -> None:
        assert self.endpoints.pop(gid) == node

    def warn(self, text: str) -> None:
        assert text.isprintable()


def ros_tokens(data: bytes) -> None:
    """Tokens that come and go: all news follow from them, and once they have gone nothing is left."""
    script = Script(data)
    far = _Far()
    there: list[str] = []
    bounds: dict[str, Any] = {"MOST_TOKENS": _MOST, "_FEW_TOKENS": 3, "_MOST_REFUSED": 1, "gid_of": _gid_of}
    with patch.multiple(graph, **bounds):
        known = RosGraph("bus", "own", _TYPES, _SERVICES, far, lambda gid: None, lambda gid: None)
        while script:
            match script.byte() % 8:
                case 0 if there:
                    known.gone(there.pop(script.byte() % len(there)))
                case 1:
                    known.refuse(announcer_of(script.choose(("ab", "cd"))))
                    known.forget_refused()
                case 2:
                    known.types_changed()
                case 3:
                    _attachment(script)
                case _:
                    there.append(_token(script))
                    known.came(there[-1])
            assert len(far.nodes) <= _MOST and len(far.endpoints) <= 2 * _MOST
            assert len(known.refused) <= 1
            assert {*known.publishers} <= {*far.endpoints}
        for key in there:
            known.gone(key)
    assert not far.nodes and not far.endpoints and not known.sessions and not known.publishers


def _gid_of(token: str) -> bytes:
    """Independent of the package xxhash."""
    return sha256(token.encode("utf-8", "surrogatepass")).digest()[:16]


def _attachment(script: Script) -> None:
    found = attachment.read(script.take(32 + script.byte() % 3))
    if found is not None:
        assert attachment.read(attachment.write(*found)) == found


def _token(script: Script) -> str:
    """A token as it is written, rarely with changed characters."""
    session = script.choose(("ab", "cd", "own", "ef"))
    kind = script.choose(("NN", "MP", "MS", "SS", "SC", "XX"))
    place = (
        script.choose(("%", "%", "%busd%x")),
        script.choose(("%", "%ns", "%a%%b")),
        f"n{script.byte() % 2}",
    )
    key = f"@ros2_lv/0/{session}/{script.byte() % 2}/{script.byte() % 3}/{kind}/{'/'.join(place)}"
    if kind != "NN":
        topic = script.choose(("%chatter", "%a%b", "%a%%b", "chatter"))
        type_name, type_hash = script.choose(
            (
                ("std_msgs::msg::dds_::String_", _STRING),
                ("std_srvs::srv::dds_::Trigger_", _TRIGGER),
                ("std_msgs::msg::dds_::String_", "RIHS01_00"),
                ("nowhere::msg::dds_::Thing_", _STRING),
            )
        )
        key += f"/{topic}/{type_name}/{type_hash}/{script.choose(('::,10:,:,:,,', '2:1:,1:,:,:,,', '::'))}"
    while (change := script.byte()) > 200:
        at = change * script.byte() % (len(key) + 1)
        key = key[:at] + script.take(2).decode(errors="replace") + key[at + script.byte() % 3 :]
    return key
