"""Each limit of a process and of a user: a process that exceeds it gets an error; others don't notice."""

import asyncio
import contextlib
import os
import signal
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import pytest
from msgspec import defstruct

import bus
from bus.qos import History, QoSProfile
from bus.wire import messages as m
from bus.wire.layout import RECORD_HEAD_BYTES
from bus.wire.runs import Run
from conftest import Daemon
from feeding import frame_record
from neighbours import resident_bytes, wait_until, with_limits
from raw_peer import HELLO, STRING, RawPeer, data
from raw_sharing import create_publisher, eventfd, memfd, share

pytestmark = pytest.mark.usefixtures("neighbours")

UID = os.getuid()
KEEP_ALL = QoSProfile(history=History.KEEP_ALL, reliability="best_effort")
LATCHED = QoSProfile(depth=100_000, durability="transient_local")
KiB, MiB = 1 << 10, 1 << 20


@contextlib.contextmanager
def crowd(daemon: Daemon, number: int) -> Iterator[list[RawPeer]]:
    with contextlib.ExitStack() as stack:
        yield [stack.enter_context(RawPeer(daemon.path)).hello() for _ in range(number)]


def peers_of(asker: RawPeer) -> m.Peers:
    answer = asker.ask(m.GetPeers(request=asker.request()))
    assert isinstance(answer, m.Peers)
    return answer


def told(answer: object) -> tuple[str, int, int]:
    assert isinstance(answer, m.Refused)
    return answer.resource, answer.used, answer.limit


@with_limits(connections_per_user=4)
async def test_connections_of_a_user(daemon: Daemon) -> None:
    text = f"connections of user {UID}: 4 of 4 in use; busd's limit can be raised in busd.toml"
    with crowd(daemon, 3):
        with RawPeer(daemon.path) as late:
            late.write(HELLO)
            assert late.fault() == text
        with pytest.raises(bus.BrokerUnavailable, match=f"connections of user {UID}: 4 of 4 in use"):
            await bus.Node("late", arguments=[]).open()


@with_limits(connections_per_user=10)
def test_connections_that_come_and_go(daemon: Daemon, other: RawPeer) -> None:
    """busd accepts ten connections at once, then ten a second; a connected process notices nothing."""
    newcomers_s: list[float] = []
    others_s: list[float] = []
    for _ in range(24):
        began_s = time.monotonic()
        with RawPeer(daemon.path) as guest:
            guest.hello()
        asked_s = time.monotonic()
        other.barrier()
        newcomers_s.append(asked_s - began_s)
        others_s.append(time.monotonic() - asked_s)
    assert sum(newcomers_s) + sum(others_s) > 1.2  # 13 of them come after the first eleven (with `other`)
    # On a busy machine both take longer, but only new connections wait for a tenth of a second.
    assert median(others_s) < median(newcomers_s[12:]) / 2


@with_limits(endpoints_per_user=12, endpoints_per_peer=6, topics_per_user=20, topics_per_peer=10)
def test_endpoints_of_a_user(daemon: Daemon) -> None:
    """The neighbours have two of the user's endpoints."""
    with crowd(daemon, 2) as (one, two):
        node = one.node()
        answers = [one.publisher(node, f"/t{at}") for at in range(7)]
        assert told(answers[-1]) == ("endpoints of a process", 6, 6)
        node = two.node()
        answers = [two.subscription(node, f"/t{at}") for at in range(5)]
        assert told(answers[-1]) == (f"endpoints of user {UID}", 12, 12)
        line = f"limit reached by raw peer (pid {os.getpid()}) of user {UID}: endpoints of user {UID}"
        wait_until(lambda: line in daemon.log.read_text())
        one.close()
        wait_until(lambda: isinstance(two.publisher(node, "/t0"), m.Created))


@with_limits(topics_per_peer=5, topics_per_user=8)
def test_topics(daemon: Daemon) -> None:
    """The neighbours use one of the topics."""
    with crowd(daemon, 2) as (one, two):
        node = one.node()
        answers = [one.publisher(node, f"/t{at}") for at in range(6)]
        assert told(answers[-1]) == ("topics of a process", 5, 5)
        assert isinstance(one.publisher(node, "/t0"), m.Created)
        node = two.node()
        answers = [two.publisher(node, f"/other{at}") for at in range(3)]
        assert told(answers[-1]) == (f"topics of user {UID}", 8, 8)


@with_limits(descriptors_per_peer=10)
def test_descriptors(daemon: Daemon) -> None:
    """One for its connection, two for its shared memory, and one for each ring."""
    with crowd(daemon, 1) as (greedy,):
        node = greedy.node()
        share(greedy)
        for _ in range(7):
            create_publisher(greedy, node, memfd())
        greedy.barrier()
        number = create_publisher(greedy, node, memfd())
        refused = greedy.expect(m.Refused)
        assert (refused.request, told(refused)) == (number, ("descriptors of a process", 10, 10))
        (mine,) = (one for one in peers_of(greedy).peers if one.program == "raw peer")
        assert mine.descriptors == 10
        assert isinstance(greedy.publisher(node, "/t"), m.Created)


@with_limits(descriptors_per_peer=10)
def test_descriptors_of_publishers_that_come_and_go(daemon: Daemon) -> None:
    """Descriptors queued for a stopped reader count for their sender, and do not use up busd's own."""
    with crowd(daemon, 1) as (flood,), RawPeer(daemon.path, receive_buffer=4096) as sleeper:
        share(sleeper.hello())
        sleeper.subscription(sleeper.node(), "/t")
        node = flood.node()
        flood.carry(m.Share(), eventfd(), memfd())
        for _ in range(1000):
            number = create_publisher(flood, node, memfd())
            while getattr(answer := flood.expect(m.Created | m.Refused), "request", 0) != number:  # type: ignore[arg-type]
                pass
            if isinstance(answer, m.Refused):
                break
            flood.send(m.DestroyEndpoint(endpoint=answer.id))
        assert told(answer)[0] == "descriptors of a process"


@with_limits(declarations_per_s_per_peer=50, nodes_per_peer=20, endpoints_per_peer=10, matches_per_peer=100)
def test_declarations_per_second(daemon: Daemon) -> None:
    with crowd(daemon, 2) as (flood, asker):
        flood.write(m.encode_frame(m.CreateNode(7, "n")) * 400)
        answers = [flood.expect(m.Created | m.Refused) for _ in range(400)]  # type: ignore[arg-type]
        refused = {told(answer) for answer in answers if isinstance(answer, m.Refused)}
        assert ("declarations per second of a process", 50, 50) in refused
        assert isinstance(answers[0], m.Created)
        flood.send(m.DestroyNode(node=answers[0].id))
        wait_until(lambda: isinstance(flood.ask(m.CreateNode(flood.request(), "late")), m.Created))
        refusals = max(one.refused for one in peers_of(asker).peers)
        assert refusals >= sum(isinstance(answer, m.Refused) for answer in answers)


@with_limits(queued_bytes_per_peer=8 * MiB, queued_bytes_per_user=8 * MiB, message_bytes=MiB)
def test_queued_bytes_of_a_user(daemon: Daemon, other: RawPeer) -> None:
    """The processes with the longest queues lose messages; the neighbours, of the same user, lose none."""
    with crowd(daemon, 4) as sleepers:
        subscriptions = [
            sleeper.subscription(sleeper.node(), "/flood", qos=KEEP_ALL).id for sleeper in sleepers
        ]
        publisher = other.publisher(other.node(), "/flood").id
        before = resident_bytes(daemon.pid)
        body = frame_record(bytes(60 * KiB), 1)
        for seq in range(1, 1001):
            other.write(data(publisher, body, first_seq=seq))
        other.barrier()
        assert resident_bytes(daemon.pid) - before < 24 * MiB
        answer = peers_of(other)
        (user,) = answer.users
        assert 6 * MiB < user.queued_bytes <= 8 * MiB
        assert sum(one.queued_bytes for one in answer.peers) == user.queued_bytes
        graph: m.GraphSnapshot = other.ask(m.GetGraph(request=other.request(), statistics=True))
        dropped = {one.id: one.statistics.dropped for one in graph.endpoints if one.statistics is not None}
        assert all(dropped[one]["memory_limit"] > 500 for one in subscriptions)
        wait_until(lambda: f"bytes queued for user {UID}" in daemon.log.read_text())


@with_limits(history_bytes_per_peer=4 * MiB, history_bytes_per_user=4 * MiB, message_bytes=MiB)
def test_history_bytes_of_a_user(daemon: Daemon) -> None:
    with crowd(daemon, 3) as talkers:
        for at, talker in enumerate(talkers):
            publisher = talker.publisher(talker.node(), f"/t{at}", qos=LATCHED).id
            for seq in range(1, 21):
                talker.write(data(publisher, frame_record(bytes(500_000), 1), first_seq=seq))
            talker.barrier()
        (user,) = peers_of(talkers[0]).users
        assert 3 * MiB < user.history_bytes <= 4 * MiB


@with_limits(control_bytes_per_peer=MiB, control_bytes_per_user=2 * MiB)
def test_control_bytes_of_a_user(daemon: Daemon, other: RawPeer) -> None:
    """Observers that do not read: busd cuts off the longest queue, before any reaches its own limit."""
    with contextlib.ExitStack() as stack:
        watchers = [stack.enter_context(RawPeer(daemon.path, receive_buffer=4096)) for _ in range(8)]
        for watcher in watchers:
            watcher.hello().send(m.Observe(request=1))
            watcher.barrier()
        for _ in range(10_000):
            created = other.ask(m.CreateNode(other.request(), "x" * 200))
            other.send(m.DestroyNode(node=created.id))
            if "it does not read" in daemon.log.read_text():
                break
        (user,) = peers_of(other).users
        assert user.connections < 2 + len(watchers)
        wait_until(lambda: sum(one.control_bytes for one in peers_of(other).peers) <= 2 * MiB)


@with_limits(queued_bytes_per_peer=16 * MiB, queued_bytes_per_user=16 * MiB, message_bytes=8 * MiB)
def test_messages_that_never_come_whole(daemon: Daemon, other: RawPeer) -> None:
    """busd bounds the total of unfinished long messages; meanwhile the neighbours keep talking."""
    with crowd(daemon, 30) as peers:
        head = struct.pack("<I", 8 * MiB) + data(1, b"")[4:]
        for peer in peers:
            peer.write(head + bytes(7 * MiB))
        wait_until(lambda: "messages that have not come whole" in daemon.log.read_text())
        other.barrier()


def test_long_messages_before_hello(daemon: Daemon) -> None:
    """Before Hello, no process can be charged for a message, so busd keeps nothing of it."""
    with contextlib.ExitStack() as stack:
        peers = [stack.enter_context(RawPeer(daemon.path)) for _ in range(5)]
        before = resident_bytes(daemon.pid)
        for peer in peers:
            peer.write(struct.pack("<I", 32 * MiB) + data(1, b"")[4:] + bytes(20 * MiB))
            assert peer.fault() == "a data frame came before Hello"
        assert resident_bytes(daemon.pid) - before < MiB
    with RawPeer(daemon.path) as peer:
        body = frame_record(bytes(8 * MiB), 1)
        peer.write(HELLO + data(1, body))
        assert peer.fault() == "a sample from publisher 1, which is not one of yours"


@with_limits(schema_bytes=200 * KiB, control_bytes_per_peer=MiB, control_bytes_per_user=3 * MiB)
def test_schemas_of_a_user(daemon: Daemon) -> None:
    before = resident_bytes(daemon.pid)
    schema = b"\xc6" + struct.pack(">I", 150_000) + bytes(150_000)
    with crowd(daemon, 6) as peers:
        refused = set()
        for at, peer in enumerate(peers):
            for number in range(20):
                peer.send(m.DeclareType(f"big/msg/T{at}_{number}", "hash", schema))
            node = peer.node()
            name = f"big/msg/T{at}_19"
            refused.add(peer.publisher(node, "/t", type_name=name, type_hash="hash").resource)
        assert refused == {"bytes of types of a process", f"bytes of types of user {UID}"}
        assert resident_bytes(daemon.pid) - before < 16 * MiB


@with_limits(schema_bytes=KiB)
async def test_a_schema_that_is_too_long(daemon: Daemon, tmp_path: Path) -> None:
    """Its endpoint is refused; the node keeps its other endpoints, and may use it at a higher limit."""
    small, large, huge = (defstruct("Wide", [(f"a{at}", int) for at in range(n)]) for n in (3, 200, 40_000))
    refusal = (
        r"the schema of local/msg/Wide has \d+ bytes, the limit is 1024; in busd.toml it is schema_bytes"
    )
    async with bus.Node("wide", arguments=[]) as node:
        publisher = await node.create_publisher(small, "/small", 10)
        subscription = await node.create_subscription(small, "/small", 10)
        for make in (node.create_publisher, node.create_subscription):
            with pytest.raises(bus.ConfigurationError, match=refusal):
                await make(large, "/large", 10)
            with pytest.raises(bus.ConfigurationError, match="more than the 1048576 that go to busd in one"):
                await make(huge, "/huge", 10)
        (tmp_path / "busd.toml").write_text(f"[limits]\nschema_bytes = {64 * KiB}\n")
        os.kill(daemon.pid, signal.SIGHUP)
        await asyncio.to_thread(wait_until, lambda: "reloaded" in daemon.log.read_text())
        await node.create_publisher(large, "/large", 10)
        publisher.publish(small(1, 2, 3))
        assert (await subscription.receive())[0] == small(1, 2, 3)
    assert "cut off" not in daemon.log.read_text()


def test_what_everybody_holds(daemon: Daemon, other: RawPeer) -> None:
    other.publisher(other.node(), "/t", type_name=STRING.name)
    answer = peers_of(other)
    assert {one.uid for one in answer.peers} == {UID}
    (mine,) = (one for one in answer.peers if one.program == "raw peer")
    assert (mine.pid, mine.nodes, mine.endpoints, mine.topics) == (os.getpid(), 1, 1, 1)
    (user,) = answer.users
    assert (user.connections, user.endpoints) == (2, 3)
    assert answer.limits["connections_per_user"] == 224


@with_limits(message_bytes=MiB, endpoints_per_peer=2)
def test_other_limits_for_who_is_there(daemon: Daemon, tmp_path: Path, peer: RawPeer, other: RawPeer) -> None:
    """Both connected while a message of 2 MiB was too long, and while two endpoints were the limit."""
    listener = other.subscription(other.node(), "/t").id
    node = peer.hello().node()
    first = peer.publisher(node, "/t")
    assert first.max_message_bytes == MiB
    peer.publisher(node, "/t")
    assert told(peer.publisher(node, "/t")) == ("endpoints of a process", 2, 2)
    (tmp_path / "busd.toml").write_text(f"[limits]\nmessage_bytes = {4 * MiB}\nendpoints_per_peer = 3\n")
    os.kill(daemon.pid, signal.SIGHUP)
    wait_until(lambda: "reloaded" in daemon.log.read_text())
    second = peer.publisher(node, "/t")
    assert second.max_message_bytes == 4 * MiB
    peer.write(data(second.id, frame_record(bytes(2 * MiB), 1)))
    run = other.expect(Run)
    assert (run.endpoint, run.source, len(run.body)) == (listener, second.id, 2 * MiB + RECORD_HEAD_BYTES)
    assert told(peer.publisher(node, "/t")) == ("endpoints of a process", 3, 3)
