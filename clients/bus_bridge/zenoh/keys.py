"""Key expressions: the names by which two bridges find each other, publishers and messages. Pure.

Tokens are liveliness tokens, which last as long as the session that declared them. `<run>` names a bridge
from its start to its end, and its groups (`groups.py`). It alone distinguishes a restarted bridge from its
predecessor.

    @busd/3/<bus>/B/<run>/<zenoh id>                                     a bus
    @busd/3/<bus>/N/<run>/<node>/<name>/<namespace>/<via>                a node
    @busd/3/<bus>/P/<run>/<node>/<gid>/<topic>/<type>/<hash>/<qos>       a publisher; S: a subscription
    @busd/3/<bus>/I/<run>/<publisher's bus>/<gid>                        the bus takes its messages

    busd/3/data/<topic without its first slash>/<type>/<hash>/<bus>/<gid>
    busd/3/type/<bus>/<type>/<hash>          queryable: the description of a type
    busd/3/kept/<bus>/<gid>/<importer>       queryable: messages kept for late joiners, missing parts
    busd/3/ack/<bus>/<gid>/<importer>        the importer's progress

Each part between two slashes is percent-encoded, so no name has a meaning in a key expression. The slashes in
the topic and the type of a data key stay: users can route by them. Incoming keys are hostile: an unreadable
token becomes `Broken`, any other unreadable key None.
"""

from typing import NamedTuple
from urllib.parse import quote, unquote

from bus.qos import QoSProfile
from bus_bridge.engine import FarEndpoint, FarNode, LocalEndpoint, LocalNode
from bus_bridge.zenoh import qos_text

__all__ = [
    "ALL_BUSES",
    "ALL_TOKENS",
    "VERSION",
    "Broken",
    "BusToken",
    "EndpointToken",
    "InterestToken",
    "NodeToken",
    "OtherVersion",
    "Token",
    "ack_key",
    "ack_keys",
    "bus_token",
    "buses_in",
    "buses_with",
    "data_key",
    "endpoint_token",
    "interest_token",
    "kept_key",
    "kept_keys",
    "node_key",
    "node_token",
    "parse_importer",
    "parse_token",
    "parse_type",
    "token_bus",
    "token_run",
    "tokens_of",
    "type_key",
    "type_keys",
]

VERSION = 3
_TOKENS = f"@busd/{VERSION}"
_KEYS = f"busd/{VERSION}"
ALL_TOKENS = f"{_TOKENS}/**"
ALL_BUSES = "@busd/*/*/B/**"
"""Buses of every protocol version, for warnings about other versions."""

_MAX_KEY = 8192
_MAX_PART = 2048
_MAX_VIA = 64
_GID_DIGITS = 32


class BusToken(NamedTuple):
    bus: str
    run: str
    zenoh_id: str


class NodeToken(NamedTuple):
    bus: str
    run: str
    node: FarNode


class EndpointToken(NamedTuple):
    bus: str
    run: str
    endpoint: FarEndpoint


class InterestToken(NamedTuple):
    """`bus` takes messages of the publisher `gid` on the bus `of`."""

    bus: str
    run: str
    of: str
    gid: bytes


class OtherVersion(NamedTuple):
    bus: str
    version: str


class Broken(NamedTuple):
    """An unreadable token of this protocol."""

    bus: str
    run: str
    reason: str


Token = BusToken | NodeToken | EndpointToken | InterestToken | OtherVersion | Broken


# --- tokens


def tokens_of(group: str) -> str:
    """The key expression of all tokens of the buses in a group."""
    return f"{_TOKENS}/*/*/{_part(group)}~$*/**"


def buses_with(bus: str) -> str:
    """The key expression of all bridges with the id of a bus, in any group, of every version."""
    return f"@busd/*/{_part(bus)}/B/**"


def buses_in(group: str) -> str:
    """The key expression of the buses in a group, of every version."""
    return f"@busd/*/*/B/{_part(group)}~$*/**"


def bus_token(bus: str, run: str, zenoh_id: str) -> str:
    return _join(_TOKENS, bus, "B", run, zenoh_id)


def node_token(bus: str, run: str, node: LocalNode) -> str:
    via = ",".join(["", *(_part(one) for one in node.via)]) or ","
    return f"{_join(_TOKENS, bus, 'N', run, str(node.id), node.name, node.namespace)}/{via}"


def endpoint_token(bus: str, run: str, endpoint: LocalEndpoint) -> str:
    kind = "P" if endpoint.kind == "publisher" else "S"
    return _join(
        _TOKENS,
        bus,
        kind,
        run,
        str(endpoint.node.id),
        endpoint.gid.hex(),
        endpoint.topic,
        endpoint.type_name,
        endpoint.type_hash,
        qos_text.write(endpoint.qos),
    )


def interest_token(bus: str, run: str, of: str, gid: bytes) -> str:
    return _join(_TOKENS, bus, "I", run, of, gid.hex())


def token_bus(key: str) -> str:
    """The bus that a token names, in its encoded form. Used to count tokens before they are read."""
    parts = key.split("/", 3)
    return parts[2] if len(parts) > 3 else ""


def token_run(key: str) -> str:
    """The run that a token names, in its encoded form."""
    parts = key.split("/", 5)
    return parts[4] if len(parts) > 4 else ""


def parse_token(key: str) -> Token:
    """Read a liveliness token."""
    parts = key.split("/")
    if len(parts) < 5 or parts[0] != "@busd":
        return Broken(_shown(token_bus(key)), "", f"its token {_shown(key)} is too short")
    bus = unquote(parts[2])
    if parts[1] != str(VERSION):
        return OtherVersion(_shown(bus), _shown(parts[1]))
    try:
        _text(parts[2])
        if len(key) > _MAX_KEY or any(len(part) > _MAX_PART for part in parts):
            raise ValueError(f"is longer than {_MAX_KEY} characters, or a part of it than {_MAX_PART}")
        return _parse(bus, parts[3], parts[4], parts[5:])
    except ValueError as error:
        return Broken(_shown(bus), _shown(parts[4]), f"its token {_shown(key)} {error}")


def _parse(bus: str, kind: str, run: str, rest: list[str]) -> Token:
    if not bus or not run:
        raise ValueError("has an empty part")
    match kind, rest:
        case "B", [zenoh_id]:
            return BusToken(bus, run, zenoh_id)
        case "N", [node, name, namespace, via]:
            return NodeToken(
                bus, run, FarNode(node_key(bus, run, node), bus, _text(name), _text(namespace), _via(via))
            )
        case (("P" | "S"), [node, gid, topic, type_name, type_hash, qos]):
            endpoint = FarEndpoint(
                "publisher" if kind == "P" else "subscription",
                _gid(gid),
                node_key(bus, run, node),
                _text(topic),
                _text(type_name),
                _text(type_hash),
                _qos(_text(qos)),
            )
            return EndpointToken(bus, run, endpoint)
        case "I", [of, gid]:
            return InterestToken(bus, run, _text(of), _gid(gid))
    raise ValueError("has a wrong number of parts")


def node_key(bus: str, run: str, node: str) -> str:
    """The bridge's name for a far node."""
    return f"{bus}/{run}/{node}"


# --- keys


def data_key(topic: str, type_name: str, type_hash: str, bus: str, gid: bytes) -> str:
    names = "/".join(_part(part) for part in f"{topic}/{type_name}".split("/") if part)
    return f"{_KEYS}/data/{names}/{_join(_part(type_hash), bus, gid.hex())}"


def type_key(bus: str, type_name: str, type_hash: str) -> str:
    return _join(f"{_KEYS}/type", bus, type_name, type_hash)


def type_keys(bus: str) -> str:
    return f"{_KEYS}/type/{_part(bus)}/*/*"


def kept_key(bus: str, gid: bytes, importer: str) -> str:
    return _join(f"{_KEYS}/kept", bus, gid.hex(), importer)


def kept_keys(bus: str) -> str:
    return f"{_KEYS}/kept/{_part(bus)}/*/*"


def ack_key(bus: str, gid: bytes, importer: str) -> str:
    return _join(f"{_KEYS}/ack", bus, gid.hex(), importer)


def ack_keys(bus: str) -> str:
    return f"{_KEYS}/ack/{_part(bus)}/*/*"


def parse_type(key: str) -> tuple[str, str] | None:
    """Name and hash in a key that `type_keys` covers."""
    parts = key.split("/")
    return None if len(parts) != 6 else (unquote(parts[4]), unquote(parts[5]))


def parse_importer(key: str) -> tuple[bytes, str] | None:
    """The publisher's gid and the importing bus in a key that `kept_keys` or `ack_keys` covers."""
    parts = key.split("/")
    if len(parts) != 6:
        return None
    try:
        return _gid(parts[4]), unquote(parts[5])
    except ValueError:
        return None


# --- parts


def _join(first: str, *parts: str) -> str:
    return "/".join([first, *(_part(part) for part in parts)])


def _part(text: str) -> str:
    return quote(text, safe="") or "%"


def _text(part: str) -> str:
    if not part or part == "%":
        raise ValueError("has an empty part")
    text = unquote(part, errors="strict")
    if not text.isprintable():
        raise ValueError("has a character that can't be printed")
    if quote(text, safe="") != part:  # else several tokens would say the same
        raise ValueError("has a part with a wrong encoding")
    return text


def _gid(part: str) -> bytes:
    if len(part) != _GID_DIGITS:
        raise ValueError(f"has a gid of {len(part)} digits instead of {_GID_DIGITS}")
    gid = bytes.fromhex(part)
    if gid.hex() != part:
        raise ValueError("has a gid with wrong digits")
    return gid


def _via(part: str) -> tuple[str, ...]:
    first, *buses = part.split(",")
    if first or len(buses) > _MAX_VIA:
        raise ValueError("has an invalid list of buses on the way")
    return tuple(_text(one) for one in buses if one)


def _qos(text: str) -> QoSProfile:
    found = qos_text.read(text)
    if found is None:
        raise ValueError("has a QoS that does not exist")
    return found


def _shown(text: str) -> str:
    text = "".join(one if one.isprintable() else "?" for one in text)
    return text if len(text) <= 80 else f"{text[:80]}..."
