"""The stories about services: the client serves, or calls (docs/services.md, "On the bus")."""

from time import monotonic_ns
from typing import Any, NamedTuple

import msgspec

from bus import names
from bus.base.counted import counted
from bus.errors import BusError
from bus.types.service import message_of
from bus.types.support import type_support
from bus_cli.doctor.conformance.conversation import Conversation, Endpoint, LeftOut, Wrong
from bus_cli.doctor.conformance.stage import Peer, Stage

__all__ = ["PLUMBING", "play_call", "play_serve", "shown"]

_CALLERS = b"conformance call", b"other conf. call"
"""The gids of two clients of the served service."""
_NUMBER = 1 << 40
_REST_S = 2.5
"""A client that has its answer asks nothing for this time."""
PLUMBING = "rcl_interfaces/"
"""Types of parameters' services: every node of the library has them."""


class _Service(NamedTuple):
    name: str
    requests: Endpoint
    replies: Endpoint


class _Envelope(NamedTuple):
    client: bytes
    number: int
    error: str
    body: bytes


def shown(talk: Conversation) -> list[str]:
    """The client's servers and clients in words."""
    ends = ((word, _services(talk, is_server=word == "server")) for word in ("server", "client"))
    return [f"{word} of {one.name} ({_type_of(one)})" for word, all_ in ends for one in all_]


async def play_serve(stage: Stage) -> str:
    """Two clients call each service. Then they ask about an answered call, and about a call never made."""
    peer = await stage.declared()
    services = _services(peer.talk, is_server=True)
    if not services:
        raise LeftOut("it serves no service")
    told = []
    for one in services:
        if one.replies.id > one.requests.id:
            raise Wrong(
                f"the server of {one.name} created its publisher of replies last; it creates it first"
            )
        body = _request_of(one)
        if body is None:
            raise LeftOut(
                f"no request can be made: DeclareType had no schema of {one.requests.schema.type_name}"
            )
        calls = [(client, _NUMBER + at) for at, client in enumerate(_CALLERS)]
        await _send(peer, one.requests, [_packed(*call, body=body) for call in calls])
        await _answered(peer, one, calls)
        asked = [calls[0], (_CALLERS[0], _NUMBER + 7)]
        for call in asked:
            await _send(peer, one.requests, [_packed(*call)])
            await _denied(peer, one, call)
        text = f"{counted(len(calls), 'call')} answered, {counted(len(asked), 'question')} too"
        told.append(f"{one.name}: {text}")
    return ", ".join(told)


async def play_call(stage: Stage) -> str:
    """A call gets no answer, and the connection ends: the client asks until it learns that the call is
    lost."""
    peer = await stage.declared()
    services = _services(peer.talk, is_server=False)
    if not services:
        raise LeftOut("it is no client of a service")
    one = services[0]
    if one.replies.id > one.requests.id:
        raise Wrong(f"the client of {one.name} created its subscription to replies last; it creates it first")
    await peer.until(lambda: one.requests.payloads, f"it did not call {one.name}")
    call = _request(one, one.requests.payloads[0])
    if call.body == _NIL:
        raise Wrong(f"its first request of {one.name} has the body nil, which is a question")
    # A reply to another client: all clients get all replies.
    await _send(peer, one.replies, [_packed(_CALLERS[0], call.number, error="of another client")])
    await peer.sign("after a reply to another client")
    peer.close()
    peer = await stage.declared()
    again = next((it for it in _services(peer.talk, is_server=False) if it.requests.gid == call.client), None)
    if again is None:
        raise Wrong(f"the client of {one.name} did not come back with its gid {call.client.hex()}")

    def questions() -> int:
        found = (_request(again, payload) for payload in again.requests.payloads)
        return sum(it.body == _NIL and it.number == call.number for it in found)

    said = f"about call {call.number} of {one.name}"
    text = f"it did not ask {said} after it had lost the connection"
    await peer.until(questions, f"{text} (it may have taken a reply to another client for its own)")
    await peer.until(lambda: questions() > 1, f"it did not ask again {said}: a bridge may lose a question")
    await _send(peer, again.replies, [_packed(call.client, call.number, error="")])
    await peer.sign(f"after the reply that its server does not know call {call.number}")
    before = questions()
    await peer.listen(_REST_S)
    if questions() > before:
        raise Wrong(f"it asked once more {said}, which has ended")
    later = [_request(again, payload) for payload in again.requests.payloads]
    if any(it.number == call.number and it.body != _NIL for it in later):
        raise Wrong(f"it used the number {call.number} for another call of {one.name}; each has its own")
    return f"{one.name}: asked about call {call.number} until it knew that the call was lost"


# --- inside

_NIL = b"\xc0"


def _services(talk: Conversation, *, is_server: bool) -> list[_Service]:
    """The client's servers or clients, except for parameters."""
    found: dict[tuple[int, str], dict[bool, Endpoint]] = {}
    for one in talk.endpoints.values():
        name = names.service_of_topic(one.topic)
        is_plain = not one.schema.type_name.startswith(PLUMBING)
        if name is not None and is_plain:
            is_request = one.topic == names.request_topic(name)
            if one.is_publisher is not (is_request is is_server):
                found.setdefault((one.node, name), {})[is_request] = one
    return [_Service(name, ends[True], ends[False]) for (_, name), ends in found.items() if len(ends) == 2]


def _type_of(service: _Service) -> str:
    return service.requests.schema.type_name.removesuffix("_Request")


def _request_of(service: _Service) -> bytes | None:
    """A request with defaults, encoded; None if the type is not known."""
    try:
        support = type_support(message_of(service.requests.schema.to_class()))
        return bytes(support.encode(support.cls()))
    except (BusError, ValueError, TypeError, KeyError):
        return None


def _packed(client: bytes, number: int, *, body: bytes = _NIL, error: str | None = None) -> bytes:
    """A request, or with `error` a reply."""
    head: list[Any] = [client, number] if error is None else [client, number, error]
    return msgspec.msgpack.encode([*head, msgspec.Raw(body)])


async def _send(peer: Peer, one: Endpoint, bodies: list[bytes]) -> None:
    await peer.write(peer.talk.feed(one, bodies, monotonic_ns()))


async def _answered(peer: Peer, service: _Service, calls: list[tuple[bytes, int]]) -> None:
    """Wait until each call has one answer. Raises Wrong for any other reply."""
    what = f"{service.name} answered fewer than {counted(len(calls), 'call')}"
    await peer.until(lambda: len(service.replies.payloads) >= len(calls), what)
    left = list(calls)
    for payload in service.replies.payloads:
        reply = _reply(service, payload)
        if (reply.client, reply.number) not in left:
            known = " and ".join(f"{number} of {client.hex()}" for client, number in left)
            text = f"call {reply.number} of {reply.client.hex()}"
            raise Wrong(f"{service.name} replied to {text}; open are {known or 'no calls'}")
        left.remove((reply.client, reply.number))
        if not reply.error and reply.body == _NIL:
            raise Wrong(f"{service.name} replied to call {reply.number} that it does not work on it")
        if reply.error and reply.body != _NIL:
            raise Wrong(
                f"a reply of {service.name} has the error {reply.error!r} and a body, which must be nil"
            )
    service.replies.payloads.clear()


async def _denied(peer: Peer, service: _Service, call: tuple[bytes, int]) -> None:
    """Wait for the reply that the server does not work on the call."""
    what = f"{service.name} did not reply to a question about call {call[1]}, on which it does not work"
    await peer.until(lambda: service.replies.payloads, what)
    reply = _reply(service, service.replies.payloads.popleft())
    if (reply.client, reply.number, reply.error, reply.body) != (*call, "", _NIL):
        text = f"error {reply.error!r} and body {reply.body[:20].hex(' ')}"
        raise Wrong(
            f"{service.name} replied to a question about call {call[1]} with call {reply.number}, {text}; "
            "both must be empty (docs/services.md)"
        )


def _request(service: _Service, payload: bytes) -> _Envelope:
    found = _parts(service.requests, payload, 3)
    if found[0] != service.requests.gid:
        text = f"{found[0].hex()}; its publisher has the gid {service.requests.gid.hex()}"
        raise Wrong(f"a request of {service.name} is of the client {text}")
    return _Envelope(found[0], found[1], "", found[2])


def _reply(service: _Service, payload: bytes) -> _Envelope:
    return _Envelope(*_parts(service.replies, payload, 4))


def _parts(one: Endpoint, payload: bytes, count: int) -> list[Any]:
    """The parts of an envelope. Its type was checked before, if it was known."""
    kinds = (bytes, int, bytes) if count == 3 else (bytes, int, str, bytes)
    try:
        parts = msgspec.msgpack.decode(payload, type=list[msgspec.Raw])
        found = [*(msgspec.msgpack.decode(part) for part in parts[: count - 1]), bytes(parts[-1])]
    except (msgspec.MsgspecError, IndexError):
        found = []
    if len(found) != count or not all(map(isinstance, found, kinds)):
        raise Wrong(f"{payload[:40].hex(' ')} on {one.topic} is no envelope (docs/services.md)")
    return found
