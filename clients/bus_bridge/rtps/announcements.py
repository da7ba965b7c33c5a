"""Descriptions of participants, readers and writers, as discovery sends them: to bytes, and back. Pure.

Owns: the meaning of parameters, and the rules of matching. Must not know: ROS 2's names, the announcers.
"""

from typing import Final, Literal, NamedTuple

from bus_bridge.rtps.ids import (
    GUID_BYTES,
    OUR_VENDOR,
    PARTICIPANT,
    PREFIX_BYTES,
    is_reader_id,
    is_writer_id,
)
from bus_bridge.rtps.messages import write_number64
from bus_bridge.rtps.parameters import (
    FOREVER_NS,
    Address,
    Order,
    Parameters,
    RtpsError,
    read_addresses,
    read_duration_ns,
    read_number,
    read_octets,
    read_parameters,
    read_properties,
    read_text,
    read_texts,
    write_address,
    write_duration,
    write_number,
    write_octets,
    write_parameters,
    write_properties,
    write_text,
)
from bus_bridge.rtps.policies import RELIABLE, Policies, is_compatible

__all__ = [
    "EndpointData",
    "EndpointKind",
    "ParticipantData",
    "Related",
    "departed",
    "inline_qos",
    "is_match",
    "read_endpoint",
    "read_participant",
    "write_endpoint",
    "write_participant",
]

EndpointKind = Literal["reader", "writer"]

_MOST_TEXT: Final = 1024
_MOST_USER_DATA: Final = 8192
_MOST_ADDRESSES: Final = 16
_MOST_DEPTH: Final = 2**31 - 1

_LEASE, _TOPIC, _TYPE, _VERSION, _VENDOR, _RELIABILITY = 0x02, 0x05, 0x07, 0x15, 0x16, 0x1A
_LIVELINESS, _DURABILITY, _DEADLINE, _PARTITION, _LIFESPAN, _USER_DATA = 0x1B, 0x1D, 0x23, 0x29, 0x2B, 0x2C
_UNICAST, _DEFAULT_UNICAST, _META_UNICAST, _HISTORY = 0x2F, 0x31, 0x32, 0x40
_PARTICIPANT_GUID, _BUILTIN_SET, _ENDPOINT_GUID = 0x50, 0x58, 0x5A
_PROPERTIES, _KEY_HASH, _STATUS, _REPRESENTATION, _RELATED = 0x59, 0x70, 0x71, 0x73, 0x83

_PL_CDR_LE: Final = b"\x00\x03\x00\x00"
_PL_CDR: Final = {b"\x00\x03": "<", b"\x00\x02": ">"}
_DISCOVERY: Final = 0x3F
"""Announcing and finding of participants, readers and writers."""
_RELIABLE: Final = 2
_MAX_BLOCKING_NS: Final = 100_000_000
_KEEP_ALL: Final = 1
_GONE: Final = 0b11
"""Disposed or unregistered."""
_XCDR1: Final = 0
_DEFAULT_LEASE_NS: Final = 100_000_000_000

_PARTICIPANT_TYPE, _DS_VERSION = "PARTICIPANT_TYPE", "DS_VERSION"
"""Names of Fast DDS's properties about Discovery Servers."""
_SERVERS: Final = frozenset(("SERVER", "BACKUP"))
_USED_DS_VERSION: Final = "2.0"


class Related(NamedTuple):
    """The identity of an announcement. A Discovery Server passes it on by its own writer, with another
    number."""

    writer: bytes
    """The GUID of the writer that made it."""
    number: int


class ParticipantData(NamedTuple):
    prefix: bytes
    vendor: bytes
    discovery_addresses: tuple[Address, ...]
    """For announcements to it."""
    addresses: tuple[Address, ...]
    """For samples to those of its readers and writers that have no own addresses."""
    lease_ns: int
    user_data: bytes = b""
    role: str = ""
    """Its role for Discovery Servers of Fast DDS; empty: none, or it did not say."""

    @property
    def is_server(self) -> bool:
        """Whether it is a Discovery Server."""
        return self.role in _SERVERS


class EndpointData(NamedTuple):
    kind: EndpointKind
    guid: bytes
    topic: str
    type_name: str
    policies: Policies = RELIABLE
    user_data: bytes = b""
    addresses: tuple[Address, ...] = ()
    is_default_partition: bool = True
    """Whether it is in the partition without a name, as all of ROS 2."""
    representations: tuple[int, ...] = (_XCDR1,)


def write_participant(data: ParticipantData) -> bytes:
    """The payload of an announcement of our participant."""
    parameters = [
        (_VERSION, b"\x02\x03"),
        (_VENDOR, data.vendor),
        (_PARTICIPANT_GUID, data.prefix + PARTICIPANT),
        (_BUILTIN_SET, write_number(_DISCOVERY)),
        *((_META_UNICAST, write_address(one)) for one in data.discovery_addresses),
        *((_DEFAULT_UNICAST, write_address(one)) for one in data.addresses),
        (_LEASE, write_duration(data.lease_ns)),
    ]
    if data.user_data:
        parameters.append((_USER_DATA, write_octets(data.user_data)))
    if data.role:
        properties = [(_PARTICIPANT_TYPE, data.role), (_DS_VERSION, _USED_DS_VERSION)]
        parameters.append((_PROPERTIES, write_properties(properties)))
    return _PL_CDR_LE + write_parameters(parameters)


def read_participant(payload: bytes, source: bytes | None) -> ParticipantData:
    """A participant; `source` is the prefix of the datagram's sender, which announces only itself.

    None: the sender is a Discovery Server, which announces others. Raises RtpsError.
    """
    order, found = _list_in(payload)
    guid = _guid(found, _PARTICIPANT_GUID)
    if source is None:
        if guid is None:
            raise RtpsError("the announcement of a participant without its GUID")
        source = guid[:PREFIX_BYTES]
    if guid is not None and guid[:PREFIX_BYTES] != source:
        raise RtpsError("the announcement of a participant by another one")
    lease_ns = read_duration_ns(found[_LEASE][0], order) if _LEASE in found else _DEFAULT_LEASE_NS
    return ParticipantData(
        source,
        found[_VENDOR][0][:2] if _VENDOR in found else bytes(2),
        _addresses(found, _META_UNICAST, order),
        _addresses(found, _DEFAULT_UNICAST, order),
        lease_ns,
        _user_data(found, order),
        _role(found, order),
    )


def write_endpoint(data: EndpointData) -> bytes:
    """The payload of an announcement of our reader or writer."""
    policies = data.policies
    max_blocking_ns = _MAX_BLOCKING_NS
    history = write_number(_KEEP_ALL if policies.keep_all else 0) + write_number(policies.depth)
    parameters = [
        (_TOPIC, write_text(data.topic)),
        (_TYPE, write_text(data.type_name)),
        (
            _RELIABILITY,
            write_number(_RELIABLE if policies.reliable else 1) + write_duration(max_blocking_ns),
        ),
        (_DURABILITY, write_number(policies.durability)),
        (_HISTORY, history),
        (_ENDPOINT_GUID, data.guid),
        (_PARTICIPANT_GUID, data.guid[:PREFIX_BYTES] + PARTICIPANT),
        (_VERSION, b"\x02\x03"),
        (_VENDOR, OUR_VENDOR),
        *((_UNICAST, write_address(one)) for one in data.addresses),
    ]
    if policies.deadline_ns < FOREVER_NS:
        parameters.append((_DEADLINE, write_duration(policies.deadline_ns)))
    if policies.lifespan_ns < FOREVER_NS:
        parameters.append((_LIFESPAN, write_duration(policies.lifespan_ns)))
    if policies.liveliness or policies.lease_ns < FOREVER_NS:
        liveliness = write_number(policies.liveliness) + write_duration(policies.lease_ns)
        parameters.append((_LIVELINESS, liveliness))
    if data.user_data:
        parameters.append((_USER_DATA, write_octets(data.user_data)))
    return _PL_CDR_LE + write_parameters(parameters)


def read_endpoint(payload: bytes, kind: EndpointKind) -> EndpointData:
    """A reader or writer, of any participant. Raises RtpsError."""
    order, found = _list_in(payload)
    guid = _guid(found, _ENDPOINT_GUID)
    if guid is None:
        raise RtpsError("an endpoint without a GUID")
    if not (is_reader_id(guid) if kind == "reader" else is_writer_id(guid)):
        raise RtpsError(f"a {kind} with the id {guid[PREFIX_BYTES:].hex()}")
    if _TOPIC not in found or _TYPE not in found:
        raise RtpsError(f"a {kind} without a topic or a type")
    topic, type_name = (read_text(found[key][0], order) for key in (_TOPIC, _TYPE))
    if max(len(topic), len(type_name)) > _MOST_TEXT:
        raise RtpsError(f"a topic or a type with more than {_MOST_TEXT} characters")
    return EndpointData(
        kind,
        guid,
        topic,
        type_name,
        _policies(found, order, kind),
        _user_data(found, order),
        _addresses(found, _UNICAST, order),
        _PARTITION not in found or _is_default(read_texts(found[_PARTITION][0], order)),
        _representations(found, order),
    )


def inline_qos(*, related: Related | None = None, gone: bytes | None = None) -> bytes:
    """Inline QoS of an announcement; empty if there is none.

    `related`: its identity, for Discovery Servers. `gone`: it says that our participant or endpoint with that
    GUID has gone.
    """
    parameters = []
    if related is not None:
        parameters.append((_RELATED, related.writer + write_number64(related.number)))
    if gone is not None:
        parameters += [(_KEY_HASH, gone), (_STATUS, bytes(3) + bytes([_GONE]))]
    return write_parameters(parameters) if parameters else b""


def departed(payload: bytes | None, inline: Parameters) -> bytes | None:
    """The GUID of a participant or endpoint that has gone; empty if that is unknown.

    None: the news are not about an end.
    """
    status = inline.get(_STATUS)
    if not status or not status[0][-1:] or not status[0][-1] & _GONE:
        return None
    key = _guid(inline, _KEY_HASH)
    if key is None and payload is not None:
        _, found = _list_in(payload)
        key = _guid(found, _ENDPOINT_GUID) or _guid(found, _PARTICIPANT_GUID)
    return key or b""


def is_match(ours: EndpointData, far: EndpointData) -> bool:
    """Whether a reader and a writer match: topic, type and QoS."""
    if ours.kind == far.kind or (ours.topic, ours.type_name) != (far.topic, far.type_name):
        return False
    reader, writer = (ours, far) if ours.kind == "reader" else (far, ours)
    return (
        far.is_default_partition
        and _XCDR1 in far.representations
        and is_compatible(writer.policies, reader.policies)
    )


def _role(found: Parameters, order: Order) -> str:
    if _PROPERTIES not in found:
        return ""
    try:
        return read_properties(found[_PROPERTIES][0], order).get(_PARTICIPANT_TYPE, "")
    except RtpsError:
        return ""  # vendors write much there, and nothing else is of interest


def _list_in(payload: bytes) -> tuple[Order, Parameters]:
    order = _PL_CDR.get(payload[:2])
    if order is None or len(payload) < 4:
        raise RtpsError(f"an announcement with the encapsulation {payload[:4].hex()}")
    return order, read_parameters(payload, order, 4).parameters


def _guid(found: Parameters, key: int) -> bytes | None:
    if key not in found:
        return None
    guid = found[key][0]
    if len(guid) != GUID_BYTES:
        raise RtpsError(f"a GUID of {len(guid)} bytes")
    return guid


def _addresses(found: Parameters, key: int, order: Order) -> tuple[Address, ...]:
    return read_addresses(found.get(key, ())[:_MOST_ADDRESSES], order)


def _user_data(found: Parameters, order: Order) -> bytes:
    if _USER_DATA not in found:
        return b""
    data = read_octets(found[_USER_DATA][0], order)
    if len(data) > _MOST_USER_DATA:
        raise RtpsError(f"{len(data)} bytes of user data; at most {_MOST_USER_DATA} are allowed")
    return data


def _policies(found: Parameters, order: Order, kind: EndpointKind) -> Policies:
    def number(key: int, default: int, at: int = 0) -> int:
        return read_number(found[key][0][at:], order) if key in found else default

    def duration_ns(key: int, at: int = 0) -> int:
        return read_duration_ns(found[key][0][at:], order) if key in found else FOREVER_NS

    return Policies(
        # The defaults of DDS: writers are reliable, readers are not.
        reliable=number(_RELIABILITY, _RELIABLE if kind == "writer" else 1) == _RELIABLE,
        durability=number(_DURABILITY, 0),
        keep_all=number(_HISTORY, 0) == _KEEP_ALL,
        depth=min(max(number(_HISTORY, 1, 4), 1), _MOST_DEPTH),
        deadline_ns=duration_ns(_DEADLINE),
        lifespan_ns=duration_ns(_LIFESPAN),
        liveliness=number(_LIVELINESS, 0),
        lease_ns=duration_ns(_LIVELINESS, 4),
    )


def _is_default(partitions: list[str]) -> bool:
    return not partitions or "" in partitions or "*" in partitions


def _representations(found: Parameters, order: Order) -> tuple[int, ...]:
    if _REPRESENTATION not in found:
        return (_XCDR1,)
    value = found[_REPRESENTATION][0]
    count = read_number(value, order)
    if 2 * count > len(value) - 4:
        raise RtpsError(f"{count} representations in {len(value)} bytes")
    endian: Literal["little", "big"] = "little" if order == "<" else "big"
    found_numbers = tuple(int.from_bytes(value[4 + 2 * at : 6 + 2 * at], endian) for at in range(count))
    return found_numbers or (_XCDR1,)
