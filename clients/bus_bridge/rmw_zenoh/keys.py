"""Keys of rmw_zenoh: of data, and of the tokens that announce nodes and their endpoints. Pure.

    0/chatter/std_msgs::msg::dds_::String_/RIHS01_...                      messages, or requests and answers
    @ros2_lv/0/<session>/<node>/<id>/NN/<enclave>/<namespace>/<name>                              a node
    @ros2_lv/0/<session>/<node>/<id>/MP/<enclave>/<namespace>/<name>/<topic>/<type>/<hash>/<qos>  an endpoint

In a part of a token, `%` stands for `/`. An empty part is `%`, too. Programs of busd have an enclave that no
program of ROS 2 has. So a bridge does not carry messages that another busd's bridge has brought.
"""

import re
from typing import Final, Literal, NamedTuple

from bus.qos import QoSProfile
from bus_bridge.rmw_zenoh import qos_text
from bus_bridge.ros2.type_names import type_from_dds, type_to_dds

__all__ = [
    "EndpointToken",
    "Kind",
    "NodeToken",
    "all_tokens",
    "data_key",
    "gid_of",
    "parse_token",
    "write_endpoint",
    "write_node",
]

Kind = Literal["MP", "MS", "SS", "SC"]
"""A publisher, a subscription, a server of a service, a client."""

_SPACE: Final = "@ros2_lv"
_ENCLAVE: Final = "%busd%"
_MOST_LETTERS: Final = 4096
_NODE_PARTS: Final = 9
_ENDPOINT_PARTS: Final = 13
_SESSION: Final = re.compile(r"[0-9a-f]{1,32}", re.ASCII)
_NUMBER: Final = re.compile(r"[0-9]{1,20}", re.ASCII)
_HASH: Final = re.compile(r"\w{1,100}", re.ASCII)
_LOW: Final = 2**64 - 1


class NodeToken(NamedTuple):
    """A node, as its token or the token of an endpoint names it."""

    session: str
    """The zenoh id of its process."""
    number: str
    """Its number in the process."""
    namespace: str
    name: str
    is_of_busd: bool

    @property
    def key(self) -> str:
        """A text that only this node has."""
        return f"{self.session}/{self.number}{self.namespace.rstrip('/')}/{self.name}"


class EndpointToken(NamedTuple):
    """An endpoint of a node."""

    node: NodeToken
    kind: Kind
    topic: str
    """The full name of the topic or service."""
    type_name: str
    """`std_msgs/msg/String`, `std_srvs/srv/Trigger`"""
    type_hash: str
    qos: QoSProfile


def all_tokens(domain: int) -> str:
    """The key expression of all tokens in a domain."""
    return f"{_SPACE}/{domain}/**"


def data_key(domain: int, topic: str, type_name: str, type_hash: str) -> str:
    """The key of a topic's messages, or of a service's requests."""
    return f"{domain}/{topic.strip('/')}/{type_to_dds(type_name)}/{type_hash}"


def write_node(domain: int, node: NodeToken, bus: str) -> str:
    """The token of a node of the bus with the id `bus`."""
    return _head(domain, node, node.number, "NN", bus)


def write_endpoint(domain: int, token: EndpointToken, number: int, bus: str) -> str:
    """The token of an endpoint of the bus with the id `bus`. `number`: its own number in its process."""
    head = _head(domain, token.node, str(number), token.kind, bus)
    topic, type_name = _mangled(token.topic), type_to_dds(token.type_name)
    return f"{head}/{topic}/{type_name}/{token.type_hash}/{qos_text.write(token.qos)}"


def parse_token(key: str) -> NodeToken | EndpointToken | None:
    """The node or endpoint of a token; None if it is not a token of rmw_zenoh. Names are not checked."""
    if len(key) > _MOST_LETTERS:
        return None
    parts = key.split("/")
    if len(parts) < _NODE_PARTS or parts[0] != _SPACE or not all(parts):
        return None
    _, _, session, node_number, number, kind, enclave, namespace, name = parts[:_NODE_PARTS]
    if not (_SESSION.fullmatch(session) and _NUMBER.fullmatch(node_number) and _NUMBER.fullmatch(number)):
        return None
    node = NodeToken(session, node_number, _demangled(namespace), name, enclave.startswith(_ENCLAVE))
    if kind == "NN":
        return node
    if len(parts) < _ENDPOINT_PARTS:
        return None
    topic, dds_type, type_hash, qos = parts[_NODE_PARTS:_ENDPOINT_PARTS]
    type_name, profile = type_from_dds(dds_type), qos_text.read(qos)
    if type_name is None or profile is None or not _HASH.fullmatch(type_hash):
        return None
    match kind:
        case "MP" | "MS" | "SS" | "SC":
            return EndpointToken(node, kind, _demangled(topic), type_name, type_hash, profile)
        case _:
            return None


def gid_of(token: str) -> bytes:
    """The gid of an endpoint: a hash of its token. Needs the package xxhash."""
    import xxhash

    found: int = xxhash.xxh3_128_intdigest(token.encode())
    return (found & _LOW).to_bytes(8, "little") + (found >> 64).to_bytes(8, "little")


def _head(domain: int, node: NodeToken, number: str, kind: str, bus: str) -> str:
    numbers = f"{domain}/{node.session}/{node.number}/{number}"
    return f"{_SPACE}/{numbers}/{kind}/{_ENCLAVE}{bus}/{_mangled(node.namespace)}/{node.name}"


def _mangled(name: str) -> str:
    return name.replace("/", "%") or "%"


def _demangled(part: str) -> str:
    return part.replace("%", "/")
