"""A peer that asks for too much: busd bounds, refuses or cuts it off; the other peers continue."""

import asyncio
import contextlib
import re
import threading
from collections.abc import Callable, Iterator

import msgspec
import pytest

import bus
from bus.msg.std_msgs import String
from bus.qos import History, QoSProfile
from bus.wire import messages as m
from conftest import WAIT_S, Daemon
from feeding import frame_record
from neighbours import descriptors_of, resident_bytes, wait_until, with_limits
from raw_peer import HELLO, STRING, RawPeer, data

pytestmark = pytest.mark.usefixtures("neighbours")

KEEP_ALL = QoSProfile(history=History.KEEP_ALL)
MiB = 1 << 20


def dropped(asker: RawPeer, subscription: int) -> dict[str, int]:
    graph: m.GraphSnapshot = asker.ask(m.GetGraph(request=asker.request(), statistics=True))
    (mine,) = (one.statistics for one in graph.endpoints if one.id == subscription)
    assert mine is not None
    return mine.dropped


@contextlib.contextmanager
def written(peer: RawPeer, raw: bytes) -> Iterator[None]:
    """Writes `raw` in the background, while the test reads."""
    writer = threading.Thread(target=peer.write, args=(raw,))
    writer.start()
    try:
        yield
    finally:
        writer.join()


def peers(asker: RawPeer) -> tuple[m.PeerRecord, ...]:
    """busd's figures about each process."""
    answer: m.Peers = asker.ask(m.GetPeers(request=asker.request()))
    return answer.peers


class TestOneThatNeverReads:
    @with_limits(queued_bytes_per_peer=2 * MiB, message_bytes=MiB, keep_all_window_bytes=MiB, lease_s=60)
    @pytest.mark.parametrize(
        "size",
        [0, pytest.param(100, marks=pytest.mark.nightly), 60_000],
    )
    def test_samples(self, daemon: Daemon, peer: RawPeer, other: RawPeer, size: int) -> None:
        """busd bounds and counts the samples queued for it, however small they are; the peer may stay."""
        sleeper = peer.hello().subscription(peer.node("sleeper"), "/flood", qos=KEEP_ALL).id
        publisher = other.publisher(other.node("talker"), "/flood").id
        before = resident_bytes(daemon.pid)
        number = 200_000 if size < 1000 else 1000
        body = frame_record(bytes(size), 1)
        for first in range(1, number, 1000):
            other.write(b"".join(data(publisher, body, first_seq=seq) for seq in range(first, first + 1000)))
        other.barrier()
        assert dropped(other, sleeper)["memory_limit"] > number // 10
        assert resident_bytes(daemon.pid) - before < 16 * MiB
        peer.barrier()

    def test_answers(self, daemon: Daemon, peer: RawPeer, other: RawPeer) -> None:
        for number in range(300):
            other.ask(m.CreateNode(request=other.request(), name=f"n{number}"))
        peer.hello().write(m.encode_frame(m.GetGraph(request=1)) * 100_000)
        assert peer.was_cut_off()
        wait_until(lambda: "it does not read" in daemon.log.read_text())
        other.barrier()

    @with_limits(lease_s=3600)
    def test_one_that_dies_before_it_has_read(self, daemon: Daemon, other: RawPeer) -> None:
        """It leaves the graph at once: busd does not wait until it has read its queue."""
        for number in range(300):
            other.ask(m.CreateNode(request=other.request(), name=f"n{number}"))
        present = len(peers(other))
        with RawPeer(daemon.path) as peer:
            peer.hello()
            questions = m.encode_frame(m.GetGraph(request=1)) * 10_000
            peer.write_some(questions)
            wait_until(lambda: MiB < max(one.control_bytes for one in peers(other)))
        wait_until(lambda: len(peers(other)) == present)

    @with_limits(
        control_bytes_per_peer=MiB,
        # busd combines changes that are close together, so their number depends on the load of the machine.
        declarations_per_s_per_peer=1_000_000,
        declarations_per_s_per_user=1_000_000,
    )
    def test_news(self, daemon: Daemon, peer: RawPeer, other: RawPeer) -> None:
        """An observer that does not read the changes it asked for."""
        peer.hello().send(m.Observe(request=1))
        peer.barrier()
        for _ in range(20_000):
            created = other.ask(m.CreateNode(request=other.request(), name="x" * 200))
            assert isinstance(created, m.Created), created
            other.send(m.DestroyNode(node=created.id))
            if "it does not read" in daemon.log.read_text():
                break
        assert peer.was_cut_off()


class TestOneThatWantsTooMuch:
    def test_ten_thousand_endpoints(self, peer: RawPeer) -> None:
        node = peer.hello().node("greedy")
        wanted = b"".join(
            m.encode_frame(
                m.CreatePublisher(n, node, f"/t{n}", STRING.name, STRING.hash, QoSProfile(), bytes(16))
            )
            for n in range(10_000)
        )
        with written(peer, wanted):
            answers = [peer.expect(m.Created | m.Refused) for _ in range(10_000)]  # type: ignore[arg-type]
        assert [type(answer) for answer in answers] == [m.Created] * 4096 + [m.Refused] * 5904
        last = answers[-1]
        assert (last.resource, last.used, last.limit) == ("endpoints of a process", 4096, 4096)  # type: ignore[attr-defined]
        graph: m.GraphSnapshot = peer.ask(m.GetGraph(request=peer.request()))
        assert len(graph.endpoints) == 4096 + 2
        peer.publisher(node, "/more")
        peer.send(m.DestroyEndpoint(endpoint=answers[0].id))
        assert isinstance(peer.publisher(node, "/more"), m.Created)

    def test_ten_thousand_nodes(self, peer: RawPeer) -> None:
        wanted = b"".join(m.encode_frame(m.CreateNode(n, f"n{n}")) for n in range(10_000))
        with written(peer.hello(), wanted):
            answers = [peer.expect(m.Created | m.Refused) for _ in range(10_000)]  # type: ignore[arg-type]
        assert sum(isinstance(answer, m.Created) for answer in answers) == 1024
        assert (answers[-1].resource, answers[-1].limit) == ("nodes of a process", 1024)  # type: ignore[attr-defined]

    @with_limits(topics=100)
    def test_topics(self, peer: RawPeer) -> None:
        node = peer.hello().node()
        answers = [peer.subscription(node, f"/t{n}") for n in range(100)]
        assert isinstance(answers[98], m.Created)
        assert (answers[99].resource, answers[99].used) == ("topics", 100)
        assert isinstance(peer.subscription(node, "/t1"), m.Created)

    @with_limits(endpoints_per_peer=3)
    async def test_what_a_user_sees(self) -> None:
        async with asyncio.timeout(WAIT_S), bus.Node("greedy", arguments=[], rosout=False) as node:
            for _ in range(3):
                await node.create_publisher(String, "/t")
            with pytest.raises(bus.QuotaExceeded) as caught:
                await node.create_subscription(String, "/t")
            assert (caught.value.used, caught.value.limit) == (3, 3)
            assert str(caught.value) == (
                "endpoints of a process: 3 of 3 in use; busd's limit can be raised in busd.toml"
            )

    def test_types_by_the_hundred(self, daemon: Daemon, peer: RawPeer) -> None:
        peer.hello()
        before = resident_bytes(daemon.pid)
        schema = msgspec.msgpack.encode(bytes(200_000))
        for number in range(400):
            peer.send(m.DeclareType(f"big/msg/T{number}", "hash", schema))
        peer.barrier()
        assert resident_bytes(daemon.pid) - before < 48 * MiB

    def test_ten_thousand_types(self, peer: RawPeer) -> None:
        """Declaring a type has no answer, so busd refuses its first use."""
        node = peer.hello().node()
        peer.send(*(m.DeclareType(f"small/msg/T{number}", "hash") for number in range(10_000)))
        answer = peer.publisher(node, "/t", type_name="small/msg/T9999", type_hash="hash")
        assert (answer.resource, answer.used, answer.limit) == ("types of a process", 4096, 4096)
        assert isinstance(peer.publisher(node, "/t", type_name="small/msg/T7", type_hash="hash"), m.Created)

    def test_a_schema_too_large(self, peer: RawPeer) -> None:
        schema = msgspec.msgpack.encode(bytes(300_000))
        node = peer.hello().node()
        for _ in range(20):
            peer.send(m.DeclareType("big/msg/T", "hash", schema))
        answer = peer.publisher(node, "/t", type_name="big/msg/T", type_hash="hash")
        assert answer.text.startswith("the schema of big/msg/T has 300005 bytes, the limit is 262144; ")
        assert isinstance(peer.publisher(node, "/t"), m.Created)

    @with_limits(history_bytes_per_peer=4 * MiB, message_bytes=MiB)
    def test_history(self, peer: RawPeer, other: RawPeer) -> None:
        latched = QoSProfile(depth=100_000, durability="transient_local")
        node = peer.hello().node()
        for topic in range(20):
            publisher = peer.publisher(node, f"/t{topic}", qos=latched).id
            for seq in range(1, 21):
                peer.write(data(publisher, frame_record(bytes(500_000), 1), first_seq=seq))
        peer.barrier()
        other.subscription(other.node(), "/t19", qos=latched)
        other.barrier()

    @with_limits(matches_per_peer=100)
    def test_matches(self, peer: RawPeer) -> None:
        """Endpoints are limited, and so must be the matches that they multiply to."""
        node = peer.hello().node()
        for _ in range(10):
            assert isinstance(peer.publisher(node, "/t"), m.Created)
            assert isinstance(peer.subscription(node, "/t"), m.Created)
        answer = peer.publisher(node, "/t")
        assert (answer.resource, answer.used, answer.limit) == ("matches of a process", 110, 100)


class TestOneThatMakesBusdTalk:
    def test_the_log_is_bounded(self, daemon: Daemon, peer: RawPeer, other: RawPeer) -> None:
        peer.hello().send(*(m.CreateNode(number, "twin") for number in range(1000)))
        peer.barrier()
        other.node("late")

        def left_out() -> int:
            other.ask(m.CreateNode(other.request(), "late"))
            return sum(map(int, re.findall(r"\((\d+) lines were left out\)", daemon.log.read_text())))

        def lines() -> int:
            return daemon.log.read_text().count("more than one node named /twin")

        wait_until(left_out)
        wait_until(lambda: left_out() + lines() >= 999)  # the next second's first line counts these
        assert 0 < lines() < 1000

    async def test_and_so_is_that_of_who_matches_none_of_its_endpoints(
        self, daemon: Daemon, peer: RawPeer, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """16,000 warnings, in busd's log and in a program's: some are printed, and the rest is counted."""
        best_effort = QoSProfile(10, reliability="best_effort")
        said = ""

        async def until_told(pattern: str, read: Callable[[], str]) -> int:
            nonlocal said
            said = ""
            async with asyncio.timeout(WAIT_S):
                while not (found := re.findall(pattern, said)):
                    await asyncio.sleep(0.05)
                    said += read()
            return sum(map(int, found))

        async with asyncio.timeout(4 * WAIT_S), bus.Node("victim", arguments=[], rosout=False) as node:
            for _ in range(16):
                await node.create_publisher(String, "/t", best_effort)
            await asyncio.to_thread(peer.hello)
            number = await asyncio.to_thread(peer.node, "greedy")
            wanted = [m.CreateSubscription(**peer.endpoint_fields(number, "/t", {})) for _ in range(1000)]
            await asyncio.to_thread(peer.send, *wanted)
            left_out = await until_told(r"(\d+) more warnings .* left out", lambda: capsys.readouterr().err)
            assert 20 <= said.count("New subscription discovered") <= 16_000 - left_out
        log = daemon.log
        left_out = await until_told(r"\((\d+) lines were left out\)", log.read_text)
        assert 0 < said.count("no match on '/t'") <= 16_000 - left_out


class TestOneThatComesTooOften:
    @with_limits(connections=4)
    async def test_connections(self, daemon: Daemon, peer: RawPeer, other: RawPeer) -> None:
        peer.hello()
        with RawPeer(daemon.path) as third:
            third.hello()
            with RawPeer(daemon.path) as fourth:
                fourth.write(HELLO)
                assert fourth.fault() == (
                    "connections: 4 of 4 in use; busd's limit can be raised in busd.toml"
                )
            with pytest.raises(bus.BrokerUnavailable) as caught:
                await bus.Node("late", arguments=[]).open()
            assert "connections: 4 of 4 in use" in str(caught.value)
        async with asyncio.timeout(WAIT_S):
            while True:
                try:
                    async with bus.Node("later", arguments=[]):
                        return
                except bus.BrokerUnavailable:
                    await asyncio.sleep(0.002)  # busd has not noticed yet that there is room

    @with_limits(connections=20)
    def test_hundreds_that_stay_silent(self, daemon: Daemon) -> None:
        """They take no places of clients that have said Hello."""
        with contextlib.ExitStack() as stack:
            for _ in range(300):
                stack.enter_context(RawPeer(daemon.path))
            heard = [stack.enter_context(RawPeer(daemon.path)).hello() for _ in range(19)]
            late = stack.enter_context(RawPeer(daemon.path))
            late.write(HELLO)
            assert "20 of 20 in use" in late.fault()
            for peer in heard:
                peer.barrier()

    def test_coming_and_going(self, daemon: Daemon) -> None:
        descriptors = descriptors_of(daemon.pid)
        for number in range(500):
            with RawPeer(daemon.path) as peer:
                if number % 2:
                    peer.write(HELLO)
                    if number % 3:
                        peer.node("short-lived"[:5])
        wait_until(lambda: descriptors_of(daemon.pid) <= descriptors)
