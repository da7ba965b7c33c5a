"""The broker core, through the real wire both ways: raw bytes, and scripts that get far into it.

For any input of its peers: it raises nothing, all its messages can be decoded, and no limit is exceeded. When
the peers have gone, no trace of them is left.
"""

from typing import Any

import msgspec
from msgspec.structs import replace

from broker_world import ALL_MAY, NUMBER, SECOND, TEXT, UID, Handle, Process, World
from bus.wire import messages as m
from bus.wire.layout import (
    CONTROL,
    DATA,
    DATA_HEAD,
    DATA_HEAD_BYTES,
    FRAME_HEAD,
    FRAME_HEAD_BYTES,
    LENGTH_BYTES,
)
from busd.core.absent import KEEP_NS
from busd.core.access import Access, AccessRule
from busd.core.limits import Limits, TopicRule
from feeding import frame_record
from fuzz.script import Script
from match_tables import check_matches

KIB = 1024
LIMITS = Limits(
    nodes_per_peer=3,
    nodes_per_user=5,
    endpoints_per_peer=6,
    endpoints_per_user=10,
    matches_per_peer=40,
    topics=5,
    schema_bytes=KIB,
    message_bytes=KIB,
    keep_all_window_bytes=KIB,
    keep_all_window_messages=4,
    queued_bytes_per_peer=2 * KIB,
    queued_bytes_per_user=3 * KIB,
    history_bytes_per_peer=KIB,
    history_bytes_per_user=KIB + 512,
    depth=20,
    lease_s=20.0,
)
TIGHT = replace(
    LIMITS, nodes_per_user=3, endpoints_per_peer=3, queued_bytes_per_peer=KIB, history_bytes_per_user=KIB
)
RULES = (TopicRule(pattern="/b", max_depth=2, max_lifespan_s=1.0),)
STRANGER = 4711
_SOME_MAY = AccessRule(
    topics=("/a", "/b"),
    actions=frozenset({"publish", "observe"}),
    uids=frozenset({STRANGER}),
)
_ACCESS = ((ALL_MAY,), (), (_SOME_MAY,), (_SOME_MAY, ALL_MAY))

_RUN_BYTES = 4 * KIB
"""More than the size of one run here: a process may exceed a limit by this, since its newest run stays."""

_NAMES = ("x", "twin", "", "9", "x" * 300)
_SPACES = ("/", "/ns", "", "ns")
_TOPICS = ("/a", "/b", "/a/c", "/d", "relative", "")
_TYPES = (TEXT, NUMBER, ("nobody/msg/Knows", "it"), ("", ""))
_CHOICES: dict[str, tuple[Any, ...]] = {
    "history": ("keep_last", "keep_all", "keep_none"),
    "reliability": ("reliable", "best_effort"),
    "durability": ("volatile", "transient_local"),
    "liveliness": ("automatic", "manual_by_topic"),
    "depth": (1, 2, 20, 21, 0, -1),
    "deadline": (0.5, 100.0, -1.0),
    "lifespan": (0.5, 1e-9, 100.0),
    "liveliness_lease_duration": (0.5, 1e-9, 100.0, float("inf")),
}
_BROUGHT = {"share": 2, "pub+": 1, "ring": 1}
_STAMPS = (10**12, 0, -(1 << 63), (1 << 63) - 1)


def control(data: bytes) -> None:
    """The bytes of a client, next to an honest one."""
    world = _world()
    witness = world.process("witness")
    client = world.process("client", shares=bool(data[:1] and data[0] & 1))
    client.send_bytes(data[1:])
    _check(world)
    _end(world, witness)


def broker(data: bytes) -> None:
    """A script of messages from three clients, mostly complete, about mostly existing objects.

    One of them belongs to another user. Limits and access change meanwhile.
    """
    script = Script(data)
    world = _world()
    witness = world.process("witness")
    clients = [_Client(world, index) for index in range(3)]
    while script:
        at = script.byte()
        index = at % 3
        if not clients[index].is_there:
            clients[index] = _Client(world, index)
        clients[index].act(at // 3 % 17, script)
        witness.tell(m.Ping())
        _check(world)
    _end(world, witness)


class _Client:
    """One process; it chooses among the ids that it was given."""

    def __init__(self, world: World, index: int) -> None:
        self.world = world
        uid = STRANGER if index == 2 else UID
        self.process: Process = world.process("client", uid=uid, shares=index > 0)
        self.ids = {"node+": [1], "pub+": [2], "sub+": [3]}
        self.next_seqs: dict[int, int] = {}
        self.gids = 0

    @property
    def is_there(self) -> bool:
        return self.process.id in self.world.processes

    def act(self, act: int, script: Script) -> None:
        match act:
            case 0:
                self.say("node+", request=1, name=script.choose(_NAMES), namespace=script.choose(_SPACES))
            case 1:
                kind = script.choose(_TYPES)
                schema = bytes(script.number(signed=False) % (2 * KIB))
                self.say("type", type_name=kind[0], type_hash=kind[1], schema=schema)
            case 2 | 3:
                more = {"next_seq": script.number(1)} if script.byte() & 1 else {}
                self.say("pub+", **self.endpoint(script), **more, descriptors=script.byte() % 2)
            case 4 | 5:
                last_seqs = {self.gid(script): script.number() for _ in range(script.byte() % 3)}
                self.say("sub+", **self.endpoint(script), last_seqs=last_seqs)
            case 6 | 7 | 8:
                self.publish(script)
            case 9:
                source, subscription = self.one_of(script, "pub+"), self.one_of(script, "sub+")
                self.say("ack", subscription=subscription, source=source, seq=script.number())
            case 10:
                self.share(script)
            case 11:
                tag, field = script.choose((("end-", "endpoint"), ("node-", "node"), ("alive", "publisher")))
                kinds = {"end-": ("pub+", "sub+"), "node-": ("node+",), "alive": ("pub+",)}[tag]
                self.say(tag, **{field: self.one_of(script, *kinds)})
            case 12:
                endpoint = self.one_of(script, "pub+", "sub+")
                dropped = {name: script.number() for name in ("replaced", "x" * 40)[: script.byte() % 3]}
                self.say("report", endpoint=endpoint, samples=script.number(), bytes=0, dropped=dropped)
            case 13:
                tag = script.choose(("graph?", "observe", "peers?", "type?", "stop", "ping", "?"))
                on = bool(script.byte() & 1)
                self.say(tag, request=script.number(), on=on, statistics=on, type_name="x", type_hash="y")
            case 14:
                self.process.is_blocked = not self.process.is_blocked
                if not self.process.is_blocked:
                    self.process.unblock()
            case 15:
                limits, access = script.choose((LIMITS, TIGHT)), Access(UID, script.choose(_ACCESS))
                core, now_ns = self.world.broker, self.world.now_ns
                self.world.carry_out(core.reconfigure(now_ns, limits, RULES, access))
            case _:
                if script.byte() % 4:
                    self.world.advance(script.choose((0.1, 0.6, 11.0)))
                else:
                    self.process.die()

    def endpoint(self, script: Script) -> dict[str, Any]:
        kind = script.choose(_TYPES)
        qos: dict[str, Any] = {}
        for name, choices in _CHOICES.items():
            if (byte := script.byte()) & 1:
                qos[name] = choices[(byte >> 1) % len(choices)]
        return {
            "request": 1,
            "node": self.one_of(script, "node+"),
            "topic": script.choose(_TOPICS),
            "type_name": kind[0],
            "type_hash": kind[1],
            "gid": self.gid(script),
            "qos": qos,
        }

    def gid(self, script: Script) -> bytes:
        return bytes([script.byte() % 4]) * (16 if script.byte() % 16 else 3)

    def one_of(self, script: Script, *kinds: str) -> int:
        ids = [number for kind in kinds for number in self.ids[kind]]
        byte = script.byte()
        return ids[byte % len(ids)] if byte < 240 else script.number()

    def share(self, script: Script) -> None:
        source, subscription = self.one_of(script, "pub+"), self.one_of(script, "sub+")
        match script.byte() % 6:
            case 0:
                self.say("attach", subscription=subscription, source=source, slot=script.number())
            case 1:
                self.say("noshm", endpoint=source, other=subscription, text="no")
            case 2:
                self.say("noshm", endpoint=subscription, other=source, text="x" * (script.byte() * 8))
            case 3:
                self.say("caught", publisher=source, subscription=subscription)
            case 4:
                self.say("ring", publisher=source, descriptors=script.byte() % 2)
            case _:
                self.say("left", subscription=subscription, source=source, seq=script.number())

    def publish(self, script: Script) -> None:
        publisher = self.one_of(script, "pub+") & 0xFFFFFFFF
        first_seq = abs(script.number(self.next_seqs.get(publisher, 1)))
        how = script.byte()
        count = 1 + (how & 3)
        if how < 240:
            size = script.byte() * (1 + (how >> 2 & 7))
            body = b"".join(frame_record(bytes(size), script.choose(_STAMPS)) for _ in range(count))
        else:
            body = script.take(script.byte())
        source = self.one_of(script, "sub+") & 0xFFFFFFFF if how & 32 else 0
        self.next_seqs[publisher] = first_seq + count
        length = DATA_HEAD_BYTES - LENGTH_BYTES + len(body)
        head = DATA_HEAD.pack(length, DATA, how >> 6, 0, publisher, source, first_seq, count, 0)
        self.process.send_bytes(head + body)

    def say(self, tag: str, **fields: Any) -> None:
        brought = fields.get("descriptors", _BROUGHT.get(tag, 0))
        if brought:
            handles = tuple(Handle("mine") for _ in range(brought))
            self.process._to_broker.descriptors.append(handles)  # type: ignore[arg-type]
        body = msgspec.msgpack.encode({"m": tag, **fields})
        before = len(self.process.sent)
        head = FRAME_HEAD.pack(FRAME_HEAD_BYTES - LENGTH_BYTES + len(body), CONTROL, 0, 0)
        self.process.send_bytes(head + body)
        if tag in self.ids:
            made = [one.id for one in self.process.sent[before:] if isinstance(one, m.Created)]
            self.ids[tag] = self.ids[tag][-5:] + made


def _world() -> World:
    return World(LIMITS, RULES, _ACCESS[0])


def _check(world: World) -> None:
    """Check that no limit is exceeded, and that the tables agree."""
    core = world.broker
    assert not core.is_overfull
    assert len(core.graph.topics) <= LIMITS.topics
    for peer in core._peers.values():
        assert len(peer.nodes) <= LIMITS.nodes_per_peer
        assert len(peer.endpoints) <= LIMITS.endpoints_per_peer
        assert len(peer.types) <= LIMITS.endpoints_per_peer
        assert 0 <= peer.matches <= LIMITS.matches_per_peer
        assert 0 <= peer.user.queued.used <= LIMITS.queued_bytes_per_user + 2 * _RUN_BYTES
        # The newest run of the latest publisher stays, whatever its size.
        assert 0 <= peer.user.history.used <= LIMITS.history_bytes_per_user + _RUN_BYTES
        assert 0 <= peer.queued.used <= LIMITS.queued_bytes_per_peer + _RUN_BYTES
        assert 0 <= peer.history.used <= LIMITS.history_bytes_per_peer + _RUN_BYTES
        assert peer.queued.used == sum(one.queue.held_bytes for one in peer.subscriptions())
        for one in peer.subscriptions():
            assert one.queue.count <= one.queue.bound
    check_matches(core.graph)


def _end(world: World, witness: Process) -> None:
    """Check that the witness is still served, and that nothing is left when all have gone."""
    graph = witness.graph(statistics=True)
    assert {node.id for node in graph.nodes} == set(world.broker.graph.nodes)
    holders = [one for peer in world.broker._peers.values() for one in (peer, peer.user)]
    accounts = [one for holder in holders for one in (holder.queued, holder.history)]
    for process in tuple(world.processes.values()):
        if process is not witness and process.id in world.processes:
            process.die()
    assert witness.cut_reason is None
    empty = witness.request(m.GetGraph(request=0), m.GraphSnapshot)
    assert (empty.nodes, empty.endpoints, empty.matches) == ((), (), ())
    witness.die()
    core = world.broker
    assert not core._peers
    assert not core.graph.types.trusted
    assert not core.graph.topics
    assert all(account.used == 0 for account in accounts)
    world.advance(100.0 + KEEP_NS / SECOND)
    assert core.next_deadline_ns() is None
