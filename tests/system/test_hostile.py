"""A peer that breaks the protocol gets the reason and is cut off; the other peers do not notice."""

import select
import signal
import socket
from collections.abc import Callable

import pytest

from bus.qos import History, QoSProfile
from bus.wire import messages as m
from bus.wire.layout import (
    CONTROL,
    DATA,
    FRAME_HEAD,
    MAX_CONTROL_BYTES,
    MAX_COUNT,
    PROTOCOL_VERSION,
)
from bus.wire.runs import Run
from conftest import Daemon
from neighbours import wait_until, with_limits
from raw_peer import HELLO, RawPeer, control, data, text

pytestmark = pytest.mark.usefixtures("neighbours")


def told_by_id(number: int) -> list[m.Message]:
    """Every message about an object with an id from the broker."""
    return [
        m.DestroyNode(node=number),
        m.DestroyEndpoint(endpoint=number),
        m.AssertLiveliness(publisher=number),
        m.Ack(subscription=number, source=number, seq=0),
        m.Report(endpoint=number, samples=0, bytes=0),
    ]


def knows_of(asker: RawPeer, node: str) -> bool:
    graph: m.GraphSnapshot = asker.ask(m.GetGraph(request=asker.request()))
    return any(one.name == node for one in graph.nodes)


GARBAGE = [
    (b"GET / HTTP/1.1\r\nHost: busd\r\n\r\n", "frame of unknown kind 47"),
    (bytes(64), "frame of unknown kind 0"),
    (b"\xff" * 64, "frame of unknown kind 255"),
    # wrong lengths: zero, less than a head, too much, the maximum
    (FRAME_HEAD.pack(0, CONTROL, 0, 0), "frame of 0 bytes"),
    (FRAME_HEAD.pack(3, CONTROL, 0, 0), "frame of 3 bytes"),
    (FRAME_HEAD.pack(5 + MAX_CONTROL_BYTES, CONTROL, 0, 0), "frame of 1048581 bytes"),
    (FRAME_HEAD.pack(0xFFFFFFFF, CONTROL, 0, 0), "frame of 4294967295 bytes"),
    (FRAME_HEAD.pack(8, CONTROL, 1, 0), "frame with unknown flags 0x1"),
    (FRAME_HEAD.pack(8, CONTROL, 0, 7), "frame with unknown flags"),
    (control(b"\xc1"), "control message not understood"),
    (control(b"\x81\xa1m\xa4what"), "control message not understood: Invalid value 'what'"),
    (control(b"\x82\xa1m\xa5graph\xa7request\x01"), "control message not understood"),
    (control(b"\x82\xa1m\xa5node+\xa4name\xa4\xff\xfe\xfd\xfc"), "control message not understood"),
    (control(b"\x91" * 30_000 + b"\xc0"), "control message not understood"),
    (control(b"\x82\xa1m\xa4ping\xa1x" + b"\x91" * 30_000 + b"\xc0"), "control message not understood"),
    (control(b"\xdd\xff\xff\xff\xff"), "control message not understood"),
    (control(b"\x82\xa1m\xa4ping\xa1x\xc6\xff\xff\xff\xff"), "control message not understood"),
]
BEFORE_HELLO = [
    (FRAME_HEAD.pack(4, DATA, 0, 0), "a data frame came before Hello"),
    (data(1, text("x")), "a data frame came before Hello"),
    (control(b""), "frame of 4 bytes; that of a Hello has 5 to 32772"),
    (control(bytes(33 << 10)), "frame of 33796 bytes; that of a Hello has 5 to 32772"),
]
AFTER_HELLO = [
    (FRAME_HEAD.pack(4, DATA, 0, 0), "frame of 4 bytes"),
    (FRAME_HEAD.pack(0xFFFFFFFF, DATA, 0, 0), "frame of 4294967295 bytes"),
    (FRAME_HEAD.pack(40, DATA, 4, 0), "frame with unknown flags 0x4"),
    (data(1, text("x"), count=0), "data frame without samples"),
    (data(1, text("x"), first_seq=MAX_COUNT, count=2), "the last number is"),
    (control(b""), "control message not understood"),
    (control(b"\x91" * 100_000 + b"\xc0"), "control message not understood"),
]


class TestBytes:
    """Bytes that are not a frame, or an incomplete one."""

    @pytest.mark.parametrize(
        ("opening", "special"),
        [(HELLO, AFTER_HELLO), (b"", BEFORE_HELLO)],
        ids=["after Hello", "before Hello"],
    )
    def test_garbage_is_named_and_ends_the_connection(
        self, daemon: Daemon, opening: bytes, special: list[tuple[bytes, str]]
    ) -> None:
        for garbage, reason in GARBAGE + special:
            with RawPeer(daemon.path) as peer:
                peer.write(opening + garbage)
                assert reason in peer.fault(), garbage[:40]

    def test_what_came_before_the_garbage_is_answered(self, peer: RawPeer) -> None:
        peer.write(HELLO + m.encode_frame(m.Ping(number=5)) + b"garbage!")
        *_, pong, fault = peer.until_end()
        assert pong == m.Pong(number=5)
        assert isinstance(fault, m.Fault)

    def test_a_frame_that_never_ends(self, daemon: Daemon, other: RawPeer) -> None:
        """Cut at every place, then closed: busd removes the sender's node, and nothing else happens."""
        with RawPeer(daemon.path) as measure:
            publisher = measure.hello().publisher(measure.node("measure"), "/t").id
        frame = data(publisher + 2, text("never heard"))
        for stop in range(len(frame)):
            with RawPeer(daemon.path) as peer:
                publisher = peer.hello().publisher(peer.node("halved"), "/t").id
                peer.write(data(publisher, text("never heard"))[:stop])
        wait_until(lambda: not knows_of(other, "halved"))

    def test_frames_drop_by_drop(self, peer: RawPeer, other: RawPeer) -> None:
        subscription = other.subscription(other.node("listener"), "/t").id
        for byte in HELLO:
            peer.write(bytes([byte]))
        peer.expect(m.Hello)
        publisher = peer.publisher(peer.node("slow"), "/t").id
        for seq in range(1, 4):
            for byte in data(publisher, text(f"drop {seq}"), first_seq=seq):
                peer.write(bytes([byte]))
        heard = [other.expect(Run) for _ in range(3)]
        assert [(run.endpoint, run.first_seq) for run in heard] == [(subscription, seq) for seq in (1, 2, 3)]
        assert all(f"drop {run.first_seq}".encode() in bytes(run.body) for run in heard)

    def test_half_closed_is_closed(self, peer: RawPeer, other: RawPeer) -> None:
        peer.hello().node("half")
        peer.socket.shutdown(socket.SHUT_WR)
        assert peer.receive() is None
        assert not knows_of(other, "half")

    def test_one_that_will_not_listen(self, peer: RawPeer, other: RawPeer) -> None:
        """busd still reads its messages until it leaves."""
        peer.hello().node("deaf")
        peer.socket.shutdown(socket.SHUT_RD)
        peer.send(m.Ping(), m.CreateNode(request=1, name="mute"), m.CreateNode(request=2, name="dumb"))
        wait_until(lambda: knows_of(other, "dumb"))
        peer.close()
        wait_until(lambda: not knows_of(other, "deaf"))

    def test_what_it_said_before_it_went_is_heard(self, peer: RawPeer, other: RawPeer) -> None:
        """busd cannot deliver the answers, but must still handle everything that it sent."""
        subscription = other.subscription(other.node(), "/t", qos=QoSProfile(depth=10_000)).id
        node = peer.hello().node()
        publisher = peer.publisher(node, "/t").id
        parts = []
        for seq in range(1, 1001):
            parts += [m.encode_frame(m.Ping(number=seq)), data(publisher, text(str(seq)), first_seq=seq)]
        peer.write(b"".join(parts))
        peer.close()
        heard = 0
        while heard < 1000:
            run = other.expect(Run)
            assert (run.endpoint, run.first_seq) == (subscription, heard + 1)
            heard += run.count

    @with_limits(lease_s=3600)
    def test_it_goes_with_answers_unread(self, daemon: Daemon, peer: RawPeer, other: RawPeer) -> None:
        """Then the kernel reports an error with the last bytes; some event loops report that only once."""
        publisher = peer.hello().publisher(peer.node("hasty"), "/t").id
        peer.send(m.Ping(number=1))
        assert peer.socket.recv(1, socket.MSG_PEEK)
        daemon.process.send_signal(signal.SIGSTOP)
        peer.write(data(publisher, text("farewell")))
        peer.close()
        daemon.process.send_signal(signal.SIGCONT)
        wait_until(lambda: not knows_of(other, "hasty"))


class TestHello:
    def test_another_version(self, peer: RawPeer) -> None:
        peer.send(m.Hello(version=PROTOCOL_VERSION + 1))
        fault = peer.fault()
        assert f"version {PROTOCOL_VERSION + 1} offered" in fault
        assert f"speaks {PROTOCOL_VERSION}" in fault

    def test_a_second_one(self, peer: RawPeer) -> None:
        peer.hello().write(HELLO)
        assert peer.fault() == "a Hello came a second time"

    def test_something_else_first(self, daemon: Daemon) -> None:
        firsts = [m.encode_frame(m.Ping()), m.encode_frame(m.StopBroker(request=1)), data(1, text("x"))]
        for first in firsts:
            with RawPeer(daemon.path) as peer:
                peer.write(first + HELLO)
                assert peer.fault().endswith("came before Hello")

    @with_limits(handshake_s=1.0)
    @pytest.mark.parametrize("part", [b"", HELLO[:5], HELLO[:-1]], ids=["silence", "a head", "a part"])
    def test_one_that_never_comes(self, peer: RawPeer, part: bytes) -> None:
        peer.write(part)
        assert peer.fault() == "no Hello within 1 s"

    @with_limits(handshake_s=1.0)
    def test_one_that_comes_too_slowly(self, peer: RawPeer) -> None:
        """Each byte is a sign of life, but they are not a Hello in time."""
        for byte in HELLO[:-1]:
            if select.select([peer.socket], [], [], 0.02)[0]:
                break
            peer.write(bytes([byte]))
        assert peer.fault() == "no Hello within 1 s"

    @with_limits(handshake_s=0.5, lease_s=1.0)
    def test_one_that_is_silent_after_it(self, daemon: Daemon, peer: RawPeer) -> None:
        """It may stay, because no other client waits for it."""
        peer.hello()
        wait_until(lambda: "no sign of life from raw" in daemon.log.read_text())
        assert peer.node("awake")
        wait_until(lambda: "is heard again" in daemon.log.read_text())  # a thread writes the log

    def test_a_name_that_does_not_fit_a_log(self, daemon: Daemon, peer: RawPeer) -> None:
        peer.send(
            m.Hello(version=PROTOCOL_VERSION, program="x\n[ERROR] [0.0] [busd]: forged\x1b[2J" + "y" * 900)
        )
        peer.expect(m.Hello)
        peer.send(m.DestroyNode(node=1))
        assert peer.fault() == "node 1 is not one of yours"
        wait_until(lambda: "is not one of yours" in daemon.log.read_text())
        log = daemon.log.read_text()
        assert "\n[ERROR]" not in log
        assert "\x1b" not in log
        assert all(len(line) < 2000 for line in log.splitlines())


class TestIds:
    """Numbers that busd never gave to this peer."""

    def test_that_do_not_exist(self, daemon: Daemon) -> None:
        for message in told_by_id(999_999):
            with RawPeer(daemon.path) as peer:
                peer.hello().send(message)
                assert peer.fault().endswith("999999 is not one of yours"), message
        with RawPeer(daemon.path) as peer:
            peer.hello().write(data(999_999, text("x")))
            assert "publisher 999999, which is not one of yours" in peer.fault()

    def test_that_are_out_of_range(self, daemon: Daemon) -> None:
        for number in (-1, -(1 << 63), 1 << 32, (1 << 64) - 1):
            for message in told_by_id(number):
                with RawPeer(daemon.path) as peer:
                    peer.hello().send(message)
                    assert peer.fault()

    def test_of_another_peer(self, daemon: Daemon, other: RawPeer) -> None:
        node = other.node("owner")
        publisher = other.publisher(node, "/owned").id
        subscription = other.subscription(node, "/owned").id
        for number in (node, publisher, subscription):
            for message in told_by_id(number):
                with RawPeer(daemon.path) as peer:
                    peer.hello().send(message)
                    assert f"{number} is not one of yours" in peer.fault(), message
            with RawPeer(daemon.path) as peer:
                peer.hello().write(data(number, text("forged")))
                assert "not one of yours" in peer.fault()
        other.write(data(publisher, text("true")))
        assert b"true" in bytes(other.expect(Run).body)

    def test_of_the_wrong_kind(self, daemon: Daemon) -> None:
        def own(peer: RawPeer) -> tuple[int, int, int]:
            node = peer.hello().node("mixed")
            return node, peer.publisher(node, "/t").id, peer.subscription(node, "/t").id

        wrong: list[Callable[[int, int, int], bytes]] = [
            lambda node, pub, sub: data(sub, text("x")),
            lambda node, pub, sub: data(node, text("x")),
            lambda node, pub, sub: m.encode_frame(m.Ack(subscription=pub, source=pub, seq=0)),
            lambda node, pub, sub: m.encode_frame(m.AssertLiveliness(publisher=sub)),
            lambda node, pub, sub: m.encode_frame(m.DestroyNode(node=pub)),
            lambda node, pub, sub: m.encode_frame(m.DestroyEndpoint(endpoint=node)),
            lambda node, pub, sub: m.encode_frame(m.Report(endpoint=node, samples=1, bytes=1)),
        ]
        for make in wrong:
            with RawPeer(daemon.path) as peer:
                peer.write(make(*own(peer)))
                assert peer.fault()

    def test_acknowledging_what_was_not_sent(self, daemon: Daemon, other: RawPeer) -> None:
        keep_all = QoSProfile(history=History.KEEP_ALL)
        publisher = other.publisher(other.node("windowed"), "/lossless", qos=keep_all).id
        for seq in (1, 1 << 40):
            with RawPeer(daemon.path) as peer:
                subscription = peer.hello().subscription(peer.node(), "/lossless", qos=keep_all).id
                peer.send(m.Ack(subscription=subscription, source=publisher, seq=seq))
                assert f"sample {seq} of publisher {publisher} acknowledged" in peer.fault()
        with RawPeer(daemon.path) as peer:
            subscription = peer.hello().subscription(peer.node(), "/lossless", qos=keep_all).id
            peer.send(m.Ack(subscription=subscription, source=publisher + 1000, seq=7))
            peer.barrier()  # the publisher may just have gone: not a fault
