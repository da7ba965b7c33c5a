"""The types of one service, and its messages in both forms: busd's envelopes, and CDR of ROS 2. Pure.

On the bus a request or answer is an array: the client's gid, the number of the call, in an answer an error
text, and the message. In DDS only the message travels as the payload. The identity of the call is elsewhere.
"""

from functools import cached_property
from typing import Annotated, Any, Final, NamedTuple

import msgspec
from msgspec import Meta, Raw

from bus.errors import BusError, ConfigurationError
from bus.schema import MessageSchema, schema_of
from bus.types.classes import service_class
from bus.types.definitions import exists
from bus.types.service import GID_BYTES, message_of, service_support
from bus_bridge.errors import BridgeError
from bus_bridge.ros2 import samples
from bus_bridge.ros2.service_hash import service_hash
from bus_ros.cdr import CdrError, Codec, codec_of

__all__ = ["Answer", "Call", "KnownServices", "ServiceTypes"]

_NIL: Final = b"\xc0"
_MOST_TEXT: Final = 2000
_pack: Final = msgspec.msgpack.Encoder().encode


class Call(NamedTuple):
    """A request of a client of this bus."""

    client: bytes
    number: int
    cdr: bytes | None
    """None: the client asks whether the server still works on this call."""


class Answer(NamedTuple):
    """An answer of a server of this bus."""

    client: bytes
    number: int
    error: str
    """Why there is no message; empty with one, and in a denial."""
    cdr: bytes | None
    """None without an error: the server does not work on this call."""


_Gid = Annotated[bytes, Meta(min_length=GID_BYTES, max_length=GID_BYTES)]
_Number = Annotated[int, Meta(ge=0)]


class _Request(msgspec.Struct, array_like=True):
    client: _Gid
    number: _Number
    body: Raw


class _Reply(msgspec.Struct, array_like=True):
    client: _Gid
    number: _Number
    error: str
    body: Raw


_read_request: Final = msgspec.msgpack.Decoder(_Request).decode
_read_reply: Final = msgspec.msgpack.Decoder(_Reply).decode


class ServiceTypes:
    """The types of a service with the name `type_name`, such as `std_srvs/srv/Trigger`.

    `requests` and `replies` are the schemas of the envelopes on the bus.
    """

    def __init__(self, type_name: str, requests: MessageSchema, replies: MessageSchema) -> None:
        self.type_name = type_name
        self.requests = requests
        self.replies = replies
        self._request, self._response = (_codec_in(schema) for schema in (requests, replies))

    @staticmethod
    def find(type_name: str) -> "ServiceTypes":
        """The types of a service of ROS 2, by its definition. Raises BridgeError if there is none."""
        try:
            if not exists(f"{type_name}_Request"):  # a message's name would take long to fail
                raise ConfigurationError(f"unknown interface '{type_name}'")
            found: Any = service_class(type_name)
            support = service_support(found)
        except BusError as error:
            raise BridgeError(f"{type_name}: {error}") from None
        return ServiceTypes(type_name, schema_of(support.requests), schema_of(support.replies(b"")))

    @staticmethod
    def of(requests: MessageSchema, replies: MessageSchema) -> "ServiceTypes":
        """The types of a service of this bus, by the schemas of its two topics. Raises BridgeError if they
        do not belong to one service, or if ROS 2 can't have the type."""
        name = requests.type_name.removesuffix("_Request")
        if (requests.type_name, replies.type_name) != (f"{name}_Request", f"{name}_Response"):
            raise BridgeError(f"{requests.type_name} and {replies.type_name} are not of one service")
        return ServiceTypes(name, requests, replies)

    @property
    def codecs(self) -> tuple[Codec, Codec]:
        """The codecs of its requests and its answers."""
        return self._request, self._response

    @cached_property
    def type_hash(self) -> str:
        """The hash of the service's type in ROS 2."""
        return service_hash(self.type_name, self._request, self._response)

    # --- from the bus to ROS 2

    def read_request(self, payload: bytes) -> Call:
        """The call in a message of the topic of requests. Raises BridgeError if there is none."""
        try:
            found = _read_request(payload)
        except (msgspec.MsgspecError, ValueError) as error:
            raise BridgeError(f"no request of {self.type_name}: {error}") from None
        body = bytes(found.body)
        return Call(found.client, found.number, None if body == _NIL else _encoded(self._request, body))

    def read_reply(self, payload: bytes) -> Answer:
        """The answer in a message of the topic of replies. Raises BridgeError if there is none."""
        try:
            found = _read_reply(payload)
        except (msgspec.MsgspecError, ValueError) as error:
            raise BridgeError(f"no answer of {self.type_name}: {error}") from None
        body = bytes(found.body)
        cdr = None if body == _NIL or found.error else _encoded(self._response, body)
        return Answer(found.client, found.number, found.error, cdr)

    # --- from ROS 2 to the bus

    def write_request(self, client: bytes, number: int, cdr: bytes) -> bytes:
        """The message of a request. Raises BridgeError if the CDR is not one."""
        return _pack(_Request(client, number, Raw(_decoded(self._request, cdr))))

    def write_reply(self, client: bytes, number: int, cdr: bytes) -> bytes:
        """The message of an answer. Raises BridgeError if the CDR is not one."""
        return _pack(_Reply(client, number, "", Raw(_decoded(self._response, cdr))))

    def write_error(self, client: bytes, number: int, error: str) -> bytes:
        """The message of an answer that says why there is none."""
        return _pack(_Reply(client, number, error[:_MOST_TEXT] or "no reason is given", Raw(_NIL)))

    def write_denial(self, client: bytes, number: int) -> bytes:
        """The message that no server works on a call."""
        return _pack(_Reply(client, number, "", Raw(_NIL)))


class KnownServices:
    """The types of services that are known so far, by name: of this bus, or found by their definition."""

    def __init__(self) -> None:
        self._by_name: dict[str, ServiceTypes] = {}
        self._by_schema: dict[tuple[str, str], MessageSchema] = {}

    def learn(self, types: ServiceTypes) -> None:
        """Add the types of a service of this bus. The first one of a name counts for ROS 2's services."""
        self._by_name.setdefault(types.type_name, types)
        for schema in (types.requests, types.replies):
            self._by_schema[schema.type_name, schema.type_hash] = schema

    def find(self, type_name: str) -> ServiceTypes:
        """The types of a service of ROS 2. Raises BridgeError if they are not known."""
        if (found := self._by_name.get(type_name)) is None:
            found = ServiceTypes.find(type_name)
            self.learn(found)
        return found

    def schema_of(self, type_name: str, type_hash: str) -> MessageSchema:
        """The schema of requests or replies by its name on the bus. Raises BridgeError if it is not known."""
        if (schema := self._by_schema.get((type_name, type_hash))) is None:
            raise BridgeError(f"{type_name} is not known here")
        return schema


def _codec_in(envelope: MessageSchema) -> Codec:
    """The codec of the message in an envelope."""
    try:
        return codec_of(MessageSchema.of(message_of(envelope.to_class())))
    except ConfigurationError as error:
        raise BridgeError(f"{envelope.type_name} can't go to ROS 2: {error}") from None


def _encoded(codec: Codec, body: bytes) -> bytes:
    try:
        return samples.encode(codec, body)
    except CdrError as error:
        raise BridgeError(str(error)) from None


def _decoded(codec: Codec, cdr: bytes) -> bytes:
    try:
        return codec.decode(cdr)
    except CdrError as error:
        raise BridgeError(str(error)) from None
