"""Data from zenoh before they are on the bus: parts of messages, and tokens. Without zenoh."""

from typing import Any
from unittest.mock import patch

from bus_bridge.batch import Sample
from bus_bridge.engine import FarBus, FarEndpoint, FarNode
from bus_bridge.zenoh import keys, presence, records
from bus_bridge.zenoh.arrival import Arrival
from bus_bridge.zenoh.presence import Presence
from bus_bridge.zenoh.records import MAX_NUMBER, Assembler, Content, Piece, Probe, Room
from fuzz.script import Script

_SMALL: dict[str, Any] = {"PART_BYTES": 64, "WHOLE_BYTES": 128}
"""Small limits: short inputs then have messages of several parts."""
_ROOM_BYTES = 2000
_OWN = "laptop"


def parts(data: bytes) -> None:
    """Parts in any order: only possible messages pass, and never more is held than there is room."""
    script = Script(data)
    room = Room(_ROOM_BYTES)
    arrival, assembler = Arrival(room), Assembler(room)
    with patch.multiple(records, **_SMALL):
        while script:
            before = arrival.last
            for content in _next(script, arrival):
                _take(content, assembler)
            assert arrival.last >= before or not arrival.is_begun
            assert 0 <= room.left <= _ROOM_BYTES - assembler.size
            missing = arrival.missing(4)
            assert missing == sorted(set(missing)) and all(arrival.last < one for one in missing)
    arrival.clear()
    assembler.clear()
    assert room.left == _ROOM_BYTES


def _next(script: Script, arrival: Arrival) -> list[Content]:
    match script.byte() % 8:
        case 0:
            pair = records.read_pair(script.take(16))
            return [] if pair is None or arrival.is_begun else arrival.begin(pair[0])
        case 1:
            return arrival.begin(script.number(signed=False)) if not arrival.is_begun else []
        case 2:
            return arrival.skip(script.number(arrival.last, signed=False)) if arrival.misses else []
        case 3:
            found = records.read_part(script.take(script.byte()), script.take(script.byte() % 48))
        case _:
            found = _made(script, arrival.last)
    if found is None:
        return []
    number, content = found
    return arrival.arrive(number, content, script.byte())


def _made(script: Script, last: int) -> tuple[int, Content] | None:
    """A part as it is sent, rarely with a changed byte in its head."""
    samples = [
        Sample(bytes(script.byte() << script.byte() % 2), script.byte(), script.byte())
        for _ in range(script.byte() % 3)
    ]
    made = list(records.pack(samples, script.number(last + 1, signed=False) >> 1))
    part = script.choose(made) if made else records.probe(script.number(last, signed=False))
    head = bytearray(part.head)
    if script.byte() % 4 == 1:
        head[script.byte() % len(head)] = script.byte()
    return records.read_part(part.payload, bytes(head))


def _take(content: Content, assembler: Assembler) -> None:
    if isinstance(content, Probe):
        return
    if isinstance(content, Piece):
        whole = assembler.add(content)
        samples = [] if whole is None else [whole]
    else:
        samples = list(content)
        assert len(samples) == content.count and samples[-1].number == content.last_number
    assert all(one.number <= MAX_NUMBER for one in samples)


class _Far:
    """The receiver of events; see bus_bridge.engine.FarSide. Each event must be about an existing object."""

    def __init__(self) -> None:
        self.nodes: dict[str, set[str]] = {}
        self.interests: list[bytes] = []

    def bus_added(self, bus: FarBus) -> None:
        assert bus.id not in self.nodes
        self.nodes[bus.id] = set()

    def bus_removed(self, bus_id: str, reason: str) -> None:
        assert reason.isprintable()
        del self.nodes[bus_id]

    def node_added(self, node: FarNode) -> None:
        assert node.key not in self.nodes[node.bus]
        self.nodes[node.bus].add(node.key)

    def node_removed(self, key: str) -> None:
        assert any(key in nodes for nodes in self.nodes.values())
        for nodes in self.nodes.values():
            nodes.discard(key)

    def endpoint_added(self, endpoint: FarEndpoint) -> None:
        assert any(endpoint.node in nodes for nodes in self.nodes.values())

    def endpoint_removed(self, gid: bytes, node: str) -> None:
        assert any(node in nodes for nodes in self.nodes.values())

    def warn(self, text: str) -> None:
        assert text.isprintable()


def tokens(data: bytes) -> None:
    """Tokens that come and go: all events follow from them, and once they have gone nothing is left."""
    script = Script(data)
    far = _Far()
    there: list[str] = []
    bounds: dict[str, Any] = {"MAX_TOKENS": 6, "MAX_RUNS": 4, "_PATIENCE": 1}
    with patch.multiple(presence, **bounds):
        known = Presence(_OWN, "5", far, far.interests.append)
        while script:
            match script.byte() % 8:
                case 0 if there:
                    known.went(there.pop(script.byte() % len(there)))
                case 1:
                    linked = {f"z{number}": ("", "host")[number % 2] for number in range(script.byte() % 4)}
                    known.poll(linked if script.byte() % 2 else None)
                case 2:
                    known.refuse(_bus(script), "no", script.choose(("", "1", "2")))
                case _:
                    there.append(_token(script))
                    known.came(there[-1])
            assert {bus for bus, *_ in known.buses()} >= set(far.nodes)
        for key in there:
            known.went(key)
        for bus in "abc":
            for run in "123":
                known.went(keys.bus_token(bus, run, "z0"))
    assert not far.nodes and not known.buses() and not known.doubles
    state: Any = known
    assert not (state._heard or state._interests or state._node_bus)


def _bus(script: Script) -> str:
    return script.choose(("a", "b", "c", _OWN))


def _token(script: Script) -> str:
    """A token as it is written, rarely with changed characters."""
    bus, run = _bus(script), script.choose(("1", "2", "3"))
    kind = script.choose("BNPSIX")
    node, gid = str(script.byte() % 3), bytes([script.byte() % 4]).rjust(16).hex()
    rest = {
        "B": [f"z{script.byte() % 4}"],
        "N": [node, "talker", "%2F", script.choose((",", ",c", "x"))],
        "P": [node, gid, "%2Fa", "p%2Fmsg%2FT", "h", script.choose(("rk10v", "bat", "rk1td5l6e7m", "rk0"))],
        "S": [node, gid, "%2Fa", "p%2Fmsg%2FT", "h", "rk10v"],
        "I": [script.choose((_OWN, "c")), gid],
        "X": [],
    }[kind]
    version = keys.VERSION + script.choose((0, 0, 1))
    key = "/".join(["@busd", str(version), bus, kind, run, *rest])
    while (change := script.byte()) > 200:
        at = change * script.byte() % (len(key) + 1)
        key = key[:at] + script.take(2).decode(errors="replace") + key[at + script.byte() % 3 :]
    return key
