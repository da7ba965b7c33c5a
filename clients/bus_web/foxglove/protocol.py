"""Foxglove's WebSocket protocol: checked requests of clients, and the frames of the server. Pure.

The older subprotocol lacks playback. The other parts used here are the same in both. Texts are JSON
objects with `op`. In binary frames the first byte is the type of the frame; numbers are little-endian.
"""

import struct
from collections.abc import Iterable, Mapping, Sequence
from enum import IntEnum
from typing import Annotated, Any, NamedTuple

import msgspec

__all__ = [
    "MOST_TEXT",
    "SDK",
    "SUBPROTOCOLS",
    "Advertise",
    "Call",
    "ClientChannel",
    "FetchAsset",
    "GetParameters",
    "Level",
    "Misunderstood",
    "Parameter",
    "PlaybackRequest",
    "PlaybackStatus",
    "Publish",
    "Said",
    "SetParameters",
    "Subscribe",
    "SubscribeConnectionGraph",
    "SubscribeParameterUpdates",
    "Unadvertise",
    "Unsubscribe",
    "UnsubscribeConnectionGraph",
    "UnsubscribeParameterUpdates",
    "asset",
    "asset_missing",
    "call_failure",
    "first_of",
    "message",
    "parameter_values",
    "playback_state",
    "read",
    "response",
    "status",
    "text",
    "time",
]

SDK = "foxglove.sdk.v1"
SUBPROTOCOLS = (SDK, "foxglove.websocket.v1")
"""The subprotocol of today's SDK and app, and that of @foxglove/ws-protocol and older clients."""

Id = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]
Word = Annotated[str, msgspec.Meta(max_length=1000)]
"""A name, or a client's id of a question."""
Words = Annotated[list[Word], msgspec.Meta(max_length=10_000)]
MOST_TEXT = 1 << 20
"""Limit of characters in one text of a client: it may subscribe to thousands of topics."""
_MOST_STATUS = 500
"""Characters of a status: it may quote a client's text."""
_PUBLISH, _CALL, _PLAYBACK_REQUEST = 1, 2, 3
_MESSAGE, _TIME, _RESPONSE, _ASSET, _PLAYBACK_STATE = 1, 2, 3, 4, 5
_PLAYBACK_HEAD = struct.Struct("<BfBQI")
"""Command, speed, whether to seek, time, length of the id."""
_MOST_ID = 1000


class Misunderstood(Exception):
    """A frame that makes no sense; the text says why."""


class Level(IntEnum):
    """Level of a status."""

    INFO = 0
    WARNING = 1
    ERROR = 2


class Subscription(msgspec.Struct):
    """`id` is the client's choice; messages come under it."""

    id: Id
    channel_id: Id = msgspec.field(name="channelId")


class Subscribe(msgspec.Struct, tag="subscribe", tag_field="op"):
    """The client wants messages of these channels."""

    subscriptions: list[Subscription]


class Unsubscribe(msgspec.Struct, tag="unsubscribe", tag_field="op"):
    """The client no longer wants messages of these channels."""

    subscription_ids: list[Id] = msgspec.field(name="subscriptionIds")


class ClientChannel(msgspec.Struct):
    """A channel on which a client publishes; `id` is its choice."""

    id: Id
    topic: str
    encoding: str
    schema_name: str = msgspec.field(name="schemaName")
    schema: str | None = None
    schema_encoding: str | None = msgspec.field(name="schemaEncoding", default=None)


class Advertise(msgspec.Struct, tag="advertise", tag_field="op"):
    """The client is about to publish on these."""

    channels: list[ClientChannel]


class Unadvertise(msgspec.Struct, tag="unadvertise", tag_field="op"):
    """The client no longer publishes on these."""

    channel_ids: list[Id] = msgspec.field(name="channelIds")


class Parameter(msgspec.Struct, omit_defaults=True):
    """`type` says what JSON can't: `byte_array` (base64), `float64`, `float64_array`. No value: not set."""

    name: Word
    value: Any = None
    type: str | None = None


class GetParameters(msgspec.Struct, tag="getParameters", tag_field="op"):
    """Without names: all of them. The answer has the same `id`."""

    names: Words = msgspec.field(name="parameterNames", default_factory=list)
    id: Word | None = None


class SetParameters(msgspec.Struct, tag="setParameters", tag_field="op"):
    """With an `id`, the client wants the values afterwards."""

    parameters: Annotated[list[Parameter], msgspec.Meta(max_length=10_000)]
    id: Word | None = None


class SubscribeParameterUpdates(msgspec.Struct, tag="subscribeParameterUpdates", tag_field="op"):
    """The client wants the values of these when they change."""

    names: Words = msgspec.field(name="parameterNames")


class UnsubscribeParameterUpdates(msgspec.Struct, tag="unsubscribeParameterUpdates", tag_field="op"):
    """The client no longer wants the values of these."""

    names: Words = msgspec.field(name="parameterNames")


class SubscribeConnectionGraph(msgspec.Struct, tag="subscribeConnectionGraph", tag_field="op"):
    """The client wants publishers, subscribers and servers, now and when they change."""


class UnsubscribeConnectionGraph(msgspec.Struct, tag="unsubscribeConnectionGraph", tag_field="op"):
    """The client no longer wants them."""


class FetchAsset(msgspec.Struct, tag="fetchAsset", tag_field="op"):
    """The client wants a file."""

    uri: str = ""
    request_id: Id = msgspec.field(name="requestId", default=0)


class PlaybackStatus(IntEnum):
    """The activity of the player."""

    PLAYING = 0
    PAUSED = 1
    BUFFERING = 2
    ENDED = 3


class PlaybackRequest(NamedTuple):
    """Requests to the player: all of them at once."""

    is_paused: bool
    speed: float
    seek_ns: int | None
    id: str
    """The state after the request has the same id."""


class Publish(NamedTuple):
    """A message on a channel of the client's."""

    channel_id: int
    data: memoryview


class Call(NamedTuple):
    """A request to a service."""

    service_id: int
    call_id: int
    encoding: str
    data: memoryview


_Text = (
    Subscribe
    | Unsubscribe
    | Advertise
    | Unadvertise
    | GetParameters
    | SetParameters
    | SubscribeParameterUpdates
    | UnsubscribeParameterUpdates
    | SubscribeConnectionGraph
    | UnsubscribeConnectionGraph
    | FetchAsset
)
Said = _Text | Publish | Call | PlaybackRequest

_decode = msgspec.json.Decoder(_Text).decode
_encode = msgspec.json.encode


def read(frame: str | bytes) -> Said:
    """Decode a frame of a client. Raises Misunderstood."""
    if isinstance(frame, str):
        if len(frame) > MOST_TEXT:
            raise Misunderstood(f"a text has {MOST_TEXT} characters at most; this one has {len(frame)}")
        try:
            said: Said = _decode(frame)
        except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
            raise Misunderstood(f"not understood: {error}") from None
        return said
    return _read_binary(frame)


def _read_binary(frame: bytes) -> Publish | Call | PlaybackRequest:
    op = frame[0] if frame else None
    view = memoryview(frame)
    if op == _PUBLISH:
        if len(frame) < 5:
            raise Misunderstood(f"a message has a channel's id in front; this frame has {len(frame)} bytes")
        return Publish(int.from_bytes(frame[1:5], "little"), view[5:])
    if op == _CALL:
        if len(frame) < 13:
            raise Misunderstood(f"a service request has 13 bytes at least; this frame has {len(frame)}")
        service_id, call_id, length = struct.unpack_from("<III", frame, 1)
        if length > len(frame) - 13:
            raise Misunderstood(
                f"the encoding's name should have {length} bytes; {len(frame) - 13} are there"
            )
        encoding = frame[13 : 13 + length].decode(errors="replace")
        return Call(service_id, call_id, encoding, view[13 + length :])
    if op == _PLAYBACK_REQUEST:
        return _read_playback_request(view[1:])
    raise Misunderstood("an empty frame" if op is None else f"no binary frame begins with {op}")


def _read_playback_request(body: memoryview) -> PlaybackRequest:
    size = _PLAYBACK_HEAD.size
    if len(body) < size:
        raise Misunderstood(
            f"a playback request has {size + 1} bytes at least; this frame has {len(body) + 1}"
        )
    command, speed, has_seek, seek_ns, length = _PLAYBACK_HEAD.unpack_from(body)
    if command > 1:
        raise Misunderstood(f"no command of playback: {command}; 0 plays, 1 pauses")
    if length > min(_MOST_ID, len(body) - size):
        most = min(_MOST_ID, len(body) - size)
        raise Misunderstood(f"the id of a playback request should have {length} bytes; {most} are possible")
    id = bytes(body[size : size + length]).decode(errors="replace")
    return PlaybackRequest(command == 1, speed, seek_ns if has_seek else None, id)


def text(op: str, **fields: Any) -> bytes:
    """A frame of the server, to be sent as a text."""
    return _encode({"op": op, **fields})


def status(level: Level, message: str, id: str | None = None) -> bytes:
    """A message for the user of the client. The last status with one `id` is valid."""
    words = message if len(message) <= _MOST_STATUS else f"{message[: _MOST_STATUS - 3]}..."
    more = {} if id is None else {"id": id}
    return text("status", level=int(level), message=words, **more)


def first_of(faults: Sequence[str]) -> str:
    """The first of them, and how many more there are: a client can do much wrong at once."""
    return faults[0] if len(faults) == 1 else f"{faults[0]} (and {len(faults) - 1} more)"


def message(subscription: int, time_ns: int, parts: Iterable[Any]) -> bytes:
    """The frame of a message; the encoded `parts` follow each other."""
    return b"".join((struct.pack("<BIQ", _MESSAGE, subscription, time_ns), *parts))


def time(time_ns: int) -> bytes:
    """The frame with the time, if it is not the wall clock's."""
    return struct.pack("<BQ", _TIME, time_ns)


def playback_state(
    status: PlaybackStatus, time_ns: int, speed: float, *, did_seek: bool, id: str = ""
) -> bytes:
    """The frame with the state of the player; `id`: of the request that it answers."""
    name = id.encode()
    head = struct.pack("<BBQfBI", _PLAYBACK_STATE, status, time_ns, speed, did_seek, len(name))
    return head + name


def response(call: Call, encoding: str, parts: Iterable[Any]) -> bytes:
    """The frame with the answer of a service."""
    name = encoding.encode()
    return b"".join((struct.pack("<BIII", _RESPONSE, call.service_id, call.call_id, len(name)), name, *parts))


def call_failure(call: Call, message: str) -> bytes:
    """The frame with the reason why there is no answer."""
    words = message[:_MOST_STATUS]
    return text("serviceCallFailure", serviceId=call.service_id, callId=call.call_id, message=words)


def parameter_values(parameters: Iterable[Parameter], id: str | None = None) -> bytes:
    """The frame with values of parameters, and with the `id` of the question."""
    more: Mapping[str, str] = {} if id is None else {"id": id}
    return text("parameterValues", parameters=list(parameters), **more)


def asset(request_id: int, data: bytes) -> bytes:
    """The frame with a file."""
    return struct.pack("<BIBI", _ASSET, request_id, 0, 0) + data


def asset_missing(request_id: int, error: str) -> bytes:
    """The frame with the reason why there is no such file."""
    name = error.encode(errors="replace")
    return struct.pack("<BIBI", _ASSET, request_id, 1, len(name)) + name
