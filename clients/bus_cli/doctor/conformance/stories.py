"""The stories: each is played to a client that was started for it, and returns what the client did.

A story raises Wrong with the client's mistake, or LeftOut if the client gives no occasion for it.
"""

from collections.abc import Awaitable, Callable, Mapping
from time import monotonic_ns
from typing import Any, NamedTuple

import msgspec

from bus.base.counted import counted
from bus.wire import messages as m
from bus_cli.doctor.conformance import payloads, real, services
from bus_cli.doctor.conformance.conversation import KEEP_ALL, Endpoint, LeftOut, Terms, Wrong, is_plain
from bus_cli.doctor.conformance.options import RELAY
from bus_cli.doctor.conformance.real import RealStage
from bus_cli.doctor.conformance.stage import Ended, Peer, Stage

__all__ = ["PROTOCOL", "STORIES", "Story", "least_next_seq"]

PROTOCOL = "docs/protocol.md"

_SAMPLES = 3
_PING_LEASE_S = 1.0
_TEXT = "this busd refuses the endpoint, to test its client"
_FULL = "this busd has no free place now, to test its client"
_ENDS = "this busd ends the connection, to test its client"
_NOTHING = "it created no endpoint on a topic of its own"
_WINDOW_SAMPLES = 3
_REST_S = 1.5
"""A publisher without credit sends nothing for this time."""
_MOST_BYTES = 200


class Story(NamedTuple):
    play: Callable[[Any], Awaitable[str]]
    section: str
    """The section to read if the client is wrong."""
    stage: type[Stage | RealStage] = Stage
    """The stage, which `play` gets."""
    page: str = PROTOCOL


async def _hello(stage: Stage) -> str:
    peer = await stage.meet()
    await peer.until(lambda: peer.talk.nodes, "no CreateNode came after busd's Hello")
    assert peer.hello is not None
    return f"version {peer.hello.version}, program {peer.hello.program!r}"


async def _declare(stage: Stage) -> str:
    talk = (await stage.declared()).talk
    shown = [f"{one} ({one.schema.type_name})" for one in talk.endpoints.values() if is_plain(one.topic)]
    shown += services.shown(talk)
    if not shown:
        raise Wrong(_NOTHING)
    return ", ".join([*(f"node {name}" for name in talk.nodes.values()), *shown])


async def _publish(stage: Stage) -> str:
    peer = await stage.declared()
    publishers = peer.talk.plain(publishers=True)
    if not publishers:
        raise LeftOut("it has no publisher")
    if (relay := _relay(peer)) is not None:
        await _feed(peer, relay[0], _SAMPLES)
    await peer.until(
        lambda: any(one.samples >= _SAMPLES for one in publishers),
        f"it published fewer than {_SAMPLES} samples on one topic",
    )
    return ", ".join(f"{one.samples} samples on {one.topic}" for one in publishers if one.samples)


async def _subscribe(stage: Stage) -> str:
    peer = await stage.declared()
    told = []
    for one in peer.talk.plain(publishers=False):
        if await _feed(peer, one, 2) and await _feed(peer, one, 1):
            told.append(f"{one.topic}: {await _confirm(peer, one)}")
    if not told:
        raise LeftOut(_no_input(peer))
    return ", ".join(told)


async def _ping(stage: Stage) -> str:
    peer = await stage.declared(lease_s=_PING_LEASE_S)
    peer.longest_silence_ns = 0
    await peer.listen(3 * _PING_LEASE_S)
    silence_s = peer.longest_silence_ns / 1e9
    if silence_s > _PING_LEASE_S:
        raise Wrong(f"it was silent for {silence_s:.1f} s; lease_s of busd's Hello was {_PING_LEASE_S:g}")
    return f"never silent for more than {silence_s:.1f} s, with a lease of {_PING_LEASE_S:g} s"


async def _unknown(stage: Stage) -> str:
    peer = await stage.declared()
    try:
        for one in tuple(peer.talk.endpoints.values()):
            await _send_odd(peer, one)
        await peer.sign("after messages with unknown fields")
    except Ended as error:
        raise Wrong(f"after a message with a field that it does not know, {error}") from None
    await peer.send_fields("later", request=1, text="of a later version")
    try:
        await peer.sign("after a message with an unknown tag")
    except Ended:
        if stage.client.status is not None:
            text = f"after a message with an unknown tag {stage.client.end_in_words()}"
            raise Wrong(f"{text}; it ignores the message, or connects again") from None
        await stage.declared()
        return "ignored unknown fields; connected again after an unknown tag"
    return "ignored unknown fields and an unknown tag"


async def _split(stage: Stage) -> str:
    peer = await stage.declared(is_cut=True)
    told = []
    for one in peer.talk.plain(publishers=False):
        if await _feed(peer, one, 2):
            told.append(f"{one.topic}: {await _confirm(peer, one)}")
    if not told:
        await peer.sign("after frames in pieces")
    return ", ".join(["all declared, with every answer byte by byte", *told])


async def _refusal(stage: Stage) -> str:
    peer = await stage.meet(Terms(refuses=_TEXT))
    try:
        await peer.until(lambda: peer.talk.refused or _serves_only(peer), _NOTHING)
        if not peer.talk.refused:
            raise LeftOut("it has only services")
        await peer.until(
            lambda: _TEXT in stage.client.output, f"it did not print the text of Refused ({_TEXT!r})"
        )
        await peer.sign("after Refused")
    except Ended:
        if not peer.talk.refused:
            raise
        if _TEXT not in stage.client.output:
            text = f"did not print the text of Refused ({_TEXT!r})"
            raise Wrong(f"it {text}; {stage.client.end_in_words()}") from None
        if stage.client.status == 0:
            raise Wrong("it ended with status 0, as if nothing was refused") from None
        if stage.client.status is not None and stage.client.status < 0:
            raise Wrong(stage.client.end_in_words()) from None
        return f"printed the text; {stage.client.end_in_words()}"
    return "printed the text and continued"


def _serves_only(peer: Peer) -> bool:
    """Whether it has declared everything, and has only ends of services."""
    return peer.is_settled and bool(services.shown(peer.talk))


async def _fault(stage: Stage) -> str:
    """The first Fault comes before the client has its node, the second one later."""
    peer = await stage.meet()
    await peer.end(m.Fault(text=_FULL, again=True))
    peer = await _back(stage, "a Fault with `again`")
    before = {one.gid: one for one in peer.talk.endpoints.values()}
    await peer.end(m.Fault(text=_ENDS))
    after = {one.gid: one for one in (await _back(stage, "a Fault")).talk.endpoints.values()}
    for gid, old in before.items():
        if is_plain(old.topic):
            _compare(old, after.get(gid))
    return "connected again after a Fault with `again` at its start, and after another one later"


async def _back(stage: Stage, after: str) -> Peer:
    try:
        return await stage.declared()
    except Wrong as error:
        raise Wrong(f"after {after}: {error}", error.section) from None


async def _events(stage: Stage) -> str:
    peer = await stage.declared()
    relay = _relay(peer)
    told = []
    for one in peer.talk.plain(publishers=False):
        is_known = await _feed(peer, one, 2)
        if is_known:
            await _confirm(peer, one)
        await peer.send(*_events_of(one), *peer.talk.replace_partner(one))
        if is_known and await _feed(peer, one, 2):
            told.append(f"{one.topic}: {await _confirm(peer, one)}")
    for one in peer.talk.plain(publishers=True):
        await peer.send(*_events_of(one), *peer.talk.replace_partner(one))
        if relay is None or one is not relay[1]:
            await _published(peer, one, one.last_seq + 1, "after another subscription had replaced the first")
            told.append(f"{one.topic}: published to both subscriptions")
    await peer.sign("after events")
    return ", ".join(told) or "continued after events"


def _events_of(one: Endpoint) -> list[m.Message]:
    """All events of an endpoint in its first match."""
    refused = m.Incompatible(
        endpoint=one.id, topic=one.topic, node="/conformance", policy="RELIABILITY", text="a test"
    )
    if one.is_publisher:
        return [refused, m.LivelinessLost(publisher=one.id)]
    lives = [
        m.LivelinessChanged(subscription=one.id, publisher=one.partner, alive=it) for it in (False, True)
    ]
    return [refused, *lives, m.Dropped(subscription=one.id, dropped={"replaced": 1})]


async def _window(stage: Stage) -> str:
    peer = await stage.declared(Terms(window_samples=_WINDOW_SAMPLES, gives_credit=False))
    lossless = [one for one in peer.talk.plain(publishers=True) if one.qos.is_lossless]
    if not lossless:
        raise LeftOut("it has no publisher that is reliable and keep all")
    for one in lossless:
        await _fill_window(peer, one, "at its start")
        await peer.send(peer.talk.give_credit(one))
        await _fill_window(peer, one, f"after Credit for {one.credit}")
    shown = ", ".join(one.topic for one in lossless)
    return f"{shown}: never more than {_WINDOW_SAMPLES} samples without credit"


async def _fill_window(peer: Peer, one: Endpoint, when: str) -> None:
    """Let a publisher send as much as it may. If it sends more, the conversation raises Wrong."""
    relay = _relay(peer)
    if relay is not None and relay[1] is one:
        await _feed(peer, relay[0], _WINDOW_SAMPLES + 1)
    await _published(peer, one, one.credit + _WINDOW_SAMPLES, when)
    await peer.listen(_REST_S)


async def _published(peer: Peer, one: Endpoint, seq: int, when: str) -> None:
    """Wait until a publisher has sent its sample `seq`."""
    text = f"{one} did not send sample {seq} {when}; its last one was"
    await peer.until(lambda: one.last_seq >= seq, lambda: f"{text} {one.last_seq}")


async def _limit(stage: Stage) -> str:
    peer = await stage.declared(Terms(max_message_bytes=_MOST_BYTES))
    relay = _relay(peer)
    if relay is None:
        raise LeftOut(f"it does not publish on {RELAY[1]} the messages of {RELAY[0]}")
    source, target = relay
    bodies = [
        payloads.make(source.schema, number, size) for number, size in ((1, 0), (2, _MOST_BYTES), (3, 0))
    ]
    known = [body for body in bodies if body is not None]
    if len(known) < len(bodies):
        raise LeftOut(f"no message of {_MOST_BYTES} bytes can be made of {source.schema.type_name}")
    await peer.write(peer.talk.feed(source, known, monotonic_ns()))
    what = f"it did not return the short message on {target.topic} that followed one of {len(known[1])} bytes"
    await peer.until(lambda: known[2] in target.payloads, what)
    return f"{target.topic}: no message above the limit of {_MOST_BYTES} bytes"


async def _restart(stage: Stage) -> str:
    peer = await stage.declared()
    before = {one.gid: one for one in peer.talk.endpoints.values()}
    relay = _relay(peer)
    fed = [one for one in peer.talk.plain(publishers=False) if await _feed(peer, one, 2)]
    for one in fed:
        await _confirm(peer, one)
    publishers = peer.talk.plain(publishers=True)
    if publishers:
        await peer.until(lambda: any(one.samples for one in publishers), "it published nothing")
    peer.close()
    peer = await stage.declared()
    after = {one.gid: one for one in peer.talk.endpoints.values()}
    for gid, old in before.items():
        if is_plain(old.topic):
            _compare(old, after.get(gid))
    if relay is not None:
        new = _relay(peer)
        assert new is not None, "compared above"
        await _feed(peer, new[0], 1)
        await _confirm(peer, new[0])
    else:
        await peer.sign("after the second declaration")
    return f"connected and declared again, {counted(len(after), 'endpoint')} with the same gids"


def _compare(old: Endpoint, new: Endpoint | None) -> None:
    """Raise Wrong if an endpoint was not declared again as it was."""
    if new is None:
        raise Wrong(f"{old} did not come back with its gid {old.gid.hex()}")
    if (old.is_publisher, old.topic) != (new.is_publisher, new.topic):
        raise Wrong(f"the gid of {old} came back for {new}")
    if old.is_publisher and new.next_seq < (least := least_next_seq(old)):
        text = f"next_seq is {new.next_seq}, and it is at least {least} after its sample {old.last_seq}"
        raise Wrong(f"{old} came back with an old number: {text}")
    if not old.is_publisher and old.samples:
        said = new.last_seqs.get(old.partner_gid)
        if said != old.last_seq:
            text = "nothing" if said is None else str(said)
            raise Wrong(
                f"{old} came back with {text} in last_seqs for publisher {old.partner_gid.hex()}; it had "
                f"received samples up to {old.last_seq}"
            )


def least_next_seq(one: Endpoint) -> int:
    """The lowest number with which a publisher may continue at another busd."""
    if one.qos.durability != "transient_local":
        return one.last_seq + 1
    # It sends its history again.
    return 1 if one.qos.history == "keep_all" else max(1, one.last_seq + 1 - one.qos.depth)


def _relay(peer: Peer) -> tuple[Endpoint, Endpoint] | None:
    """Both ends of the relay, if the client is one."""
    ends = {one.topic: one for one in peer.talk.endpoints.values()}
    source, target = (ends.get(topic) for topic in RELAY)
    if source is None or target is None or source.is_publisher or not target.is_publisher:
        return None
    return source, target


async def _feed(peer: Peer, one: Endpoint, count: int) -> bool:
    """Send samples to a subscription; False if its type is not known."""
    bodies = [payloads.make(one.schema, one.samples + number) for number in range(1, count + 1)]
    known = [body for body in bodies if body is not None]
    if len(known) < count:
        return False
    await peer.write(peer.talk.feed(one, known, monotonic_ns()))
    return True


async def _confirm(peer: Peer, one: Endpoint) -> str:
    """Wait until the client shows that it has taken the samples; returns how it did."""
    relay = _relay(peer)
    shown = [await _returned(peer, *relay)] if relay is not None and relay[0] is one else []
    if one.qos.is_lossless:
        what = f"no Ack of sample {one.last_seq} came for {one}"
        await peer.until(lambda: one.acknowledged >= one.last_seq, what, section=KEEP_ALL)
        shown.append(f"{one.samples} samples acknowledged")
    if not shown:
        await peer.sign(f"after {one.samples} samples for {one}")
        shown.append(f"{one.samples} samples sent")
    return ", ".join(shown)


async def _returned(peer: Peer, source: Endpoint, target: Endpoint) -> str:
    sent = [payloads.make(source.schema, number) for number in range(1, source.samples + 1)]
    what = f"{target} returned fewer than the {len(sent)} samples of {source.topic}"
    if source.partners > 1:
        what += f", of which {source.last_seq} are of a second publisher with numbers from 1"
    await peer.until(lambda: len(target.payloads) >= len(sent), lambda: f"{what}: {len(target.payloads)}")
    for number, (there, back) in enumerate(zip(sent, target.payloads, strict=False), 1):
        if there != back:
            assert there is not None
            raise Wrong(
                f"sample {number} of {source.topic} ({there.hex(' ')}) came back on {target.topic} as "
                f"{back.hex(' ')}"
            )
    return f"{len(sent)} samples returned on {target.topic}"


async def _send_odd(peer: Peer, one: Endpoint) -> None:
    """Messages that a client need not understand, with fields that it can't know."""
    odd = {"later": {"list": [1, None, 2.5]}}
    about: m.Message
    if one.is_publisher:
        about = m.Incompatible(
            endpoint=one.id, topic=one.topic, node="/conformance", policy="RELIABILITY", text="a test"
        )
    else:
        about = m.Dropped(subscription=one.id, dropped={"replaced": 1})
    fields = msgspec.to_builtins(about)
    await peer.send_fields(fields.pop("m"), **fields, **odd)


def _no_input(peer: Peer) -> str:
    found = [one.schema.type_name for one in peer.talk.plain(publishers=False)]
    if not found:
        return "it has no subscription"
    return f"no message can be made: DeclareType had no schema of {', '.join(found)}"


STORIES: Mapping[str, Story] = {
    "hello": Story(_hello, "The session"),
    "declare": Story(_declare, "From a client"),
    "publish": Story(_publish, "Frames"),
    "subscribe": Story(_subscribe, "Frames"),
    "ping": Story(_ping, "Liveliness"),
    "unknown": Story(_unknown, "Versions"),
    "split": Story(_split, "Frames"),
    "refusal": Story(_refusal, "Errors and limits"),
    "fault": Story(_fault, "The session"),
    "events": Story(_events, "From busd"),
    "window": Story(_window, KEEP_ALL),
    "limit": Story(_limit, "From busd"),
    "restart": Story(_restart, "When busd goes away"),
    "serve": Story(services.play_serve, "On the bus", page="docs/services.md"),
    "call": Story(services.play_call, "On the bus", page="docs/services.md"),
    "real": Story(real.play, "The least that a client does", RealStage),
    "growth": Story(real.play_growth, "Growth", RealStage, "docs/ring.md"),
}
