"""Messages between a client and a service: a request or a reply in an envelope with the call's client and
number.

Owns: the two envelopes, and the descriptions of their types on the bus. On the wire, an envelope is an array
with the message's own encoding as its last element. So any class with a TypeSupport can be used. Must not
know: topics, endpoints.

The topic `_request` of a service has the type `<pkg>/srv/<Name>_Request`, the topic `_reply` has
`<pkg>/srv/<Name>_Response`. In both, the name of the inner message ends in a digest of both definitions. If
one definition differs, neither topic matches, so no client sends a call that no server could answer.
"""

from collections.abc import Callable
from copy import copy
from functools import cache, cached_property
from typing import Annotated, Any, Final, Generic, TypeAlias, TypeVar

import msgspec
from msgspec import Meta, Raw, Struct

from bus.errors import ConfigurationError, MessageTypeError
from bus.qos import History, QoSProfile
from bus.types.hash import schema_hash
from bus.types.schema import Schema, build, describe
from bus.types.schema_form import is_type_name
from bus.types.support import TypeSupport, type_support

__all__ = ["GID_BYTES", "Reply", "Request", "ServiceSupport", "keeping_all", "message_of", "service_support"]

GID_BYTES: Final = 16
_DIGITS: Final = 16
_NIL: Final = 0xC0
_NOTHING: Final = Raw(bytes((_NIL,)))
_MOST_TEXT: Final = 2000

_HEAD: Final[list[dict[str, Any]]] = [
    {"name": "client", "type": ["bytes", GID_BYTES, GID_BYTES], "required": True},
    {"name": "number", "type": "uint64", "required": True},
]
_encode = msgspec.msgpack.encode


class Request(Struct, array_like=True):
    """One call. `client` is the gid of the publisher that sent it, `number` the client's own."""

    client: bytes
    number: int
    body: Any
    """The decoded message. None: the client asks whether the server still works on this call."""


class Reply(Struct, array_like=True):
    """The answer to a call; if `error` is not empty, there is no body."""

    client: bytes
    number: int
    error: str
    body: Any
    """None without an error: the server does not work on this call, and has sent any answer to it before."""


# A server sends gids back to all clients, so a longer one is refused.
_Gid: TypeAlias = Annotated[bytes, Meta(min_length=GID_BYTES, max_length=GID_BYTES)]
_Number: TypeAlias = Annotated[int, Meta(ge=0)]


class _RawRequest(Struct, array_like=True):
    client: _Gid
    number: _Number
    body: Raw


class _RawReply(Struct, array_like=True):
    client: _Gid
    number: _Number
    error: str
    body: Raw


E = TypeVar("E", bound=Struct)


class EnvelopeSupport(TypeSupport[E], Generic[E]):
    """The TypeSupport of an envelope: it decodes, and describes the type for the bus. It encodes nothing."""

    def __init__(
        self, cls: type[E], name: str, described: tuple[str, bytes], decode: Callable[[Any], E]
    ) -> None:
        self.cls = cls
        self.name = name
        self.hash, self.description = described
        self.decode = decode
        self.encode = _encode
        self.is_valid = _unsure
        self.plan = None


class ServiceSupport:
    """The types of one service, for both sides; made by `service_support(service_type)`.

    Raises MessageTypeError if `service_type` is no definition of a service, ConfigurationError for a bad type
    name.
    """

    def __init__(self, service_type: Any) -> None:
        self._type = service_type
        described = getattr(service_type, "__described__", None)
        if described is None:
            self.request, self.response  # noqa: B018 - raises an error if one is missing
        self.name: str = getattr(service_type, "__type_name__", "") or self.request.name.removesuffix(
            "_Request"
        )
        if not is_type_name(f"{self.name}_Response_{'0' * _DIGITS}") or "/msg/" in self.name:
            raise ConfigurationError(
                f"__type_name__ of {service_type!r:.80} must have three parts, like 'std_srvs/srv/SetBool'; "
                f"it is {self.name!r}"
            )
        names = f"{self.name}_Request", f"{self.name}_Response"
        asked, answered = described or self._describe(*names)
        self.requests = EnvelopeSupport(Request, names[0], asked, self._decode_request)
        self._answers = EnvelopeSupport(Reply, names[1], answered, _decode_nothing)
        self._read_request = msgspec.msgpack.Decoder(_RawRequest).decode
        self._read_reply = msgspec.msgpack.Decoder(_RawReply).decode

    # Many services of a node are never called, so the first call looks up the support of their messages.

    @cached_property
    def request(self) -> TypeSupport[Any]:
        return self._support_of("Request")

    @cached_property
    def response(self) -> TypeSupport[Any]:
        return self._support_of("Response")

    def _support_of(self, part: str) -> TypeSupport[Any]:
        try:
            message = getattr(self._type, part)
        except AttributeError:
            raise MessageTypeError(
                f"{self._type!r:.80} is no service: it has no message classes Request and Response"
            ) from None
        return type_support(message)

    def _describe(self, *names: str) -> tuple[tuple[str, bytes], tuple[str, bytes]]:
        """Hash and description of requests and of answers, which get these names."""
        # The names of the messages' classes in this process don't matter to other processes.
        bodies = _renamed(self.request.schema, names[0]), _renamed(self.response.schema, names[1])
        digest = _digest(*map(schema_hash, bodies))
        asked = _envelope(names[0], digest, bodies[0], is_answer=False)
        answered = _envelope(names[1], digest, bodies[1], is_answer=True)
        return _described(asked), _described(answered)

    def replies(self, client: bytes) -> EnvelopeSupport[Reply]:
        """The envelope of replies for the client with that gid: bodies for other clients stay None."""
        read = self._read_reply

        def decode(payload: Any) -> Reply:
            raw = read(payload)
            is_answer = raw.client == client and not raw.error
            # The bytes lie in a ring, so they can't be kept undecoded.
            view = memoryview(raw.body)
            body = self.response.decode(view) if is_answer and view[0] != _NIL else None
            return Reply(raw.client, raw.number, raw.error, body)

        support = copy(self._answers)
        support.decode = decode
        return support

    def encode_request(self, client: bytes, number: int, request: object) -> bytes:
        """Encode a request. Raises MessageTypeError for an object of another class, or a wrong field."""
        return _encode(_RawRequest(client, number, Raw(self.request.encode_checked(request))))

    def encode_response(self, client: bytes, number: int, response: object) -> bytes:
        """Encode a response. Raises MessageTypeError for an object of another class, or a wrong field."""
        return _encode(_RawReply(client, number, "", Raw(self.response.encode_checked(response))))

    def encode_question(self, client: bytes, number: int) -> bytes:
        """Encode the question whether the server still works on a call."""
        return _encode(_RawRequest(client, number, _NOTHING))

    def encode_denial(self, client: bytes, number: int) -> bytes:
        """Encode the answer that the server does not work on a call."""
        return _encode(_RawReply(client, number, "", _NOTHING))

    def encode_error(self, client: bytes, number: int, text: str) -> bytes:
        """Encode an answer with an error text instead of a response."""
        # The text of an exception may contain anything, but must be valid text on the wire.
        error = text[:_MOST_TEXT].encode("utf-8", "replace").decode() or "no reason is given"
        return _encode(_RawReply(client, number, error, _NOTHING))

    def _decode_request(self, payload: Any) -> Request:
        raw = self._read_request(payload)
        view = memoryview(raw.body)
        body = self.request.decode(view) if view[0] != _NIL else None
        return Request(raw.client, raw.number, body)


@cache
def service_support(service_type: Any) -> ServiceSupport:
    """The ServiceSupport of a class with `Request`, `Response` and `__type_name__`, made once."""
    return ServiceSupport(service_type)


def keeping_all(qos: QoSProfile) -> QoSProfile:
    """The QoS of a service's subscriptions: keep all, because a depth would bound the messages of all senders
    together."""
    return msgspec.structs.replace(qos, history=History.KEEP_ALL)


def message_of(envelope: type[Struct]) -> type[Struct]:
    """The class of the inner message, from a class made of an envelope's schema.

    Raises ConfigurationError if the schema describes another kind of type.
    """
    schema = describe(envelope)
    root, types = schema["root"], schema["types"]
    inner = [name for name in types if name.startswith(f"{root}_") and len(name) == len(root) + 1 + _DIGITS]
    if len(inner) != 1:
        raise ConfigurationError(f"{root} on the bus is no request or reply of a service")
    rest = {name: type_ for name, type_ in types.items() if name != root}
    return build(_renamed({"root": inner[0], "types": rest}, root))


def _envelope(name: str, digest: str, body: Schema, *, is_answer: bool) -> Schema:
    inner = f"{name}_{digest}"
    fields = [*_HEAD]
    if is_answer:
        fields.append({"name": "error", "type": "string", "required": True})
    node = ["union", inner, "none"] if is_answer else inner
    fields.append({"name": "body", "type": node, "required": True})
    types = _renamed(body, inner)["types"]
    return {"root": name, "types": {name: {"array": True, "fields": fields}, **types}}


def _described(schema: Schema) -> tuple[str, bytes]:
    return schema_hash(schema), msgspec.msgpack.encode(schema)


def _renamed(schema: Schema, root: str) -> Schema:
    """The same schema with another name for its root, to which no type in it refers."""
    old = schema["root"]
    return {
        "root": root,
        "types": {root if name == old else name: type_ for name, type_ in schema["types"].items()},
    }


def _digest(*hashes: str) -> str:
    from hashlib import sha256  # slow to import

    return sha256(" ".join(hashes).encode()).hexdigest()[:_DIGITS]


def _unsure(_: object) -> bool:
    return False


def _decode_nothing(payload: object) -> Reply:
    raise MessageTypeError("replies are decoded by their client")
