"""Descriptors from peers: good ones reach their recipients, bad ones are refused, and none stays open."""

import errno
import fcntl
import mmap
import os
import resource
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from bus.base.descriptor import Descriptor
from bus.wire import messages as m
from bus.wire.layout import PROTOCOL_VERSION
from bus.wire.session import MAX_BATCHES
from conftest import Daemon
from lingering import lingering_socket
from neighbours import descriptors_of, wait_until
from raw_peer import RawPeer
from raw_sharing import FUTURE_WRITE, SEALS, SIZE, create_publisher, eventfd, memfd, share


def regular_file() -> Descriptor:
    return Descriptor(os.open(__file__, os.O_RDONLY | os.O_CLOEXEC))


def pipe() -> Descriptor:
    reading, writing = os.pipe()
    os.close(writing)
    return Descriptor(reading)


def unix_socket() -> Descriptor:
    return Descriptor(socket.socket(socket.AF_UNIX).detach())


BAD_SEGMENTS: dict[str, tuple[Callable[[], Descriptor], str]] = {
    "a regular file": (regular_file, "no memfd"),
    "a pipe": (pipe, "no memfd"),
    "a socket": (unix_socket, "no memfd"),
    "an eventfd": (eventfd, "no memfd"),
    "no seals": (lambda: memfd(seals=0), "lacks the seals SHRINK, GROW, FUTURE_WRITE"),
    "may shrink": (lambda: memfd(seals=SEALS & ~fcntl.F_SEAL_SHRINK), "lacks the seals SHRINK"),
    "may be written": (lambda: memfd(seals=SEALS & ~FUTURE_WRITE), "lacks the seals FUTURE_WRITE"),
    "empty": (lambda: memfd(size=0), "has 0 bytes"),
    "too small": (lambda: memfd(size=100), "has 100 bytes"),
    "full of holes": (lambda: memfd(is_reserved=False), "not reserved"),
}
BAD_DOORBELLS: dict[str, tuple[Callable[[], Descriptor], str]] = {
    "one that blocks": (lambda: Descriptor(os.eventfd(0, os.EFD_CLOEXEC)), "would block"),
    "a regular file": (regular_file, "no eventfd"),
    "a pipe": (pipe, "no eventfd"),
    "a socket": (unix_socket, "no eventfd"),
    "a segment": (memfd, "no eventfd"),
}


def same(one: Descriptor, other: Descriptor) -> bool:
    """Whether both are one file. (All eventfds count as one.)"""
    return os.path.sameopenfile(one.fileno(), other.fileno())


@pytest.fixture
def nothing_left(daemon: Daemon) -> Iterator[None]:
    """busd has as many descriptors after the test as before."""
    with RawPeer(daemon.path) as first:
        first.hello()
    before = descriptors_of(daemon.pid)
    yield
    wait_until(lambda: descriptors_of(daemon.pid) <= before)


@pytest.mark.usefixtures("nothing_left")
class TestBad:
    @pytest.mark.parametrize("what", BAD_SEGMENTS)
    @pytest.mark.parametrize("which", ["CreatePublisher", "ReplaceRing", "Share"])
    def test_segments(self, daemon: Daemon, other: RawPeer, which: str, what: str) -> None:
        with RawPeer(daemon.path) as peer:
            node = peer.hello().node()
            make, reason = BAD_SEGMENTS[what]
            bad = make()
            match which:
                case "Share":
                    bell = eventfd()
                    peer.carry(m.Share(), bell, bad)
                case "ReplaceRing":
                    peer.carry(m.ReplaceRing(publisher=peer.publisher(node, "/t").id), bad)
                case _:
                    create_publisher(peer, node, bad)
            told = peer.fault()
            assert told.startswith(f"{which} with a bad descriptor: ") and reason in told
        other.barrier()

    @pytest.mark.parametrize("what", BAD_DOORBELLS)
    def test_doorbells(self, daemon: Daemon, other: RawPeer, what: str) -> None:
        with RawPeer(daemon.path) as peer:
            make, reason = BAD_DOORBELLS[what]
            bad, readers = make(), memfd()
            peer.hello().carry(m.Share(), bad, readers)
            told = peer.fault()
            assert told.startswith("Share with a bad descriptor: ") and reason in told
        other.barrier()

    def test_more_than_a_message_brings(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as peer:
            node = peer.hello().node()
            create_publisher(peer, node, memfd(), memfd(), claims=2)
            assert peer.fault() == "CreatePublisher with 2 descriptors instead of 1 or none"

    def test_fewer_than_a_message_brings(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as peer:
            bell = eventfd()
            peer.hello().carry(m.Share(descriptors=1), bell)
            assert peer.fault() == "Share with 1 descriptors instead of 2 or none"

    @pytest.mark.parametrize("number", [0, 2, 5])
    def test_another_number_than_claimed_is_none(self, daemon: Daemon, number: int) -> None:
        with RawPeer(daemon.path) as peer:
            node = peer.hello().node()
            share(peer)
            rings = [memfd() for _ in range(number)]
            request = create_publisher(peer, node, *rings)
            assert peer.expect(m.Created).request == request
            subscription = peer.subscription(node, "/t").id
            told = peer.expect(m.Matched)
            assert (told.route, told.descriptors) == ("socket", 0)
            assert subscription in (told.endpoint, told.other)
            wait_until(lambda: "/raw shares no memory on '/t': its ring was lost" in daemon.log.read_text())

    def test_with_what_brings_none(self, daemon: Daemon, other: RawPeer) -> None:
        with RawPeer(daemon.path) as peer:
            peer.hello()
            ring = memfd()
            for _ in range(MAX_BATCHES + 1):
                peer.carry(m.Ping(), ring)
            assert peer.fault() == "descriptors that no message claims"
        other.barrier()

    def test_far_too_many(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as peer:
            peer.hello().carry(m.Ping(), *[memfd()] * 100)
            assert peer.fault() == "100 descriptors at once, a message brings 2 at most"

    def test_before_hello(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as peer:
            share(peer)
            assert peer.fault() == "a Share came before Hello"

    def test_half_a_frame(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as peer:
            ring = memfd()
            peer.hello()
            socket.send_fds(peer.socket, [m.encode_frame(m.ReplaceRing(publisher=1))[:-1]], [ring.fileno()])


class TestStrange:
    """Descriptors that take long to close, in each way by which busd can receive them."""

    @pytest.mark.parametrize(
        "way", ["claimed", "unclaimed", "many", "before Hello", "behind a fault", "behind garbage"]
    )
    def test_a_socket_that_lingers_holds_up_nobody(self, daemon: Daemon, other: RawPeer, way: str) -> None:
        with lingering_socket() as strange, RawPeer(daemon.path) as peer:
            node = 0 if way in ("before Hello", "behind garbage") else peer.hello().node()
            daemon.process.send_signal(signal.SIGSTOP)  # otherwise the test might close it last
            match way:
                case "claimed":
                    create_publisher(peer, node, strange)
                case "many":
                    peer.carry(m.Ping(), *[strange] * 100)
                case "before Hello":
                    peer.carry(m.Hello(version=PROTOCOL_VERSION), strange)
                case _:  # "unclaimed", or behind bytes that end the connection
                    peer.write(b"" if way == "unclaimed" else b"\xff" * 64)
                    peer.carry(m.Ping(), strange)
            strange.close()
            peer.close()
            daemon.process.send_signal(signal.SIGCONT)
            other.barrier()


@pytest.mark.usefixtures("nothing_left")
class TestGood:
    def test_they_reach_whom_they_are_for(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as talker, RawPeer(daemon.path) as listener:
            bell, _ = share(talker.hello())
            other_bell, readers = share(listener.hello())
            ring, larger = memfd(), memfd(size=2 * SIZE)
            create_publisher(talker, talker.node("talker"), ring)
            publisher = talker.expect(m.Created).id
            subscription = listener.subscription(listener.node("listener"), "/t").id
            matched = listener.expect(m.Matched)
            assert (matched.endpoint, matched.other, matched.route) == (subscription, publisher, "shm")
            assert same(listener.descriptors[0], ring) and same(listener.descriptors[1], bell)
            assert talker.expect(m.Matched).route == "shm"

            listener.send(m.Attach(subscription=subscription, source=publisher, slot=3))
            attached = talker.expect(m.Attached)
            assert (attached.publisher, attached.subscription, attached.slot) == (publisher, subscription, 3)
            assert attached.pid == os.getpid()
            assert same(talker.descriptors[0], readers) and same(talker.descriptors[1], other_bell)

            talker.carry(m.ReplaceRing(publisher=publisher), larger)
            assert listener.expect(m.RingReplaced).source == publisher
            assert same(listener.descriptors[0], larger)
            talker.descriptors = listener.descriptors = ()

    def test_a_ring_is_held_as_long_as_its_publisher(self, daemon: Daemon, other: RawPeer) -> None:
        with RawPeer(daemon.path) as peer:
            node = peer.hello().node()
            peer.barrier()
            before = descriptors_of(daemon.pid)
            for _ in range(3):
                create_publisher(peer, node, memfd())
                publisher = peer.expect(m.Created).id
                assert descriptors_of(daemon.pid) == before + 1
                peer.carry(m.ReplaceRing(publisher=publisher), memfd())
                peer.barrier()
                assert descriptors_of(daemon.pid) == before + 1
                peer.send(m.DestroyEndpoint(endpoint=publisher))
                peer.barrier()
                assert descriptors_of(daemon.pid) == before

    def test_one_that_does_not_read_is_told_nothing_and_holds_nothing(self, daemon: Daemon) -> None:
        """At its end busd drops everything queued for it."""
        with RawPeer(daemon.path) as talker, RawPeer(daemon.path, receive_buffer=1) as sleeper:
            share(sleeper.hello())
            share(talker.hello())
            sleeper.subscription(sleeper.node("sleeper"), "/t")
            node = talker.node("talker")
            for _ in range(300):
                create_publisher(talker, node, memfd())
                talker.send(m.DestroyEndpoint(endpoint=talker.expect(m.Created).id))
            talker.barrier()


class TestLimits:
    def test_busd_takes_as_many_as_it_may(self, start_daemon: Callable[..., Daemon]) -> None:
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        with ExitStack() as stack:
            stack.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
            resource.setrlimit(resource.RLIMIT_NOFILE, (min(soft, 512), hard))
            daemon = start_daemon()
        assert resource.prlimit(daemon.pid, resource.RLIMIT_NOFILE) == (hard, hard)

    def test_rings_leave_room_for_connections(self, daemon: Daemon, other: RawPeer) -> None:
        """busd reserves 256 descriptors for connections; once the others are used, it reports lost rings."""
        _, hard = resource.prlimit(daemon.pid, resource.RLIMIT_NOFILE)
        resource.prlimit(daemon.pid, resource.RLIMIT_NOFILE, (320, hard))
        with RawPeer(daemon.path) as peer:
            node = peer.hello().node()
            for _ in range(100):
                create_publisher(peer, node, memfd())
                peer.expect(m.Created)
            assert descriptors_of(daemon.pid) < 320 - 256
            wait_until(lambda: "its ring was lost" in daemon.log.read_text())
        other.barrier()
        for _ in range(3):
            with RawPeer(daemon.path) as late:
                late.hello().barrier()

    def test_out_of_descriptors(self, daemon: Daemon, other: RawPeer) -> None:
        """The kernel does not deliver descriptors beyond the limit; the rest of the message arrives."""
        _, hard = resource.prlimit(daemon.pid, resource.RLIMIT_NOFILE)
        with RawPeer(daemon.path) as peer:
            node = peer.hello().node()
            peer.barrier()
            resource.prlimit(daemon.pid, resource.RLIMIT_NOFILE, (descriptors_of(daemon.pid), hard))
            create_publisher(peer, node, memfd())
            assert peer.expect(m.Created).id
            wait_until(lambda: "its ring was lost" in daemon.log.read_text())
            resource.prlimit(daemon.pid, resource.RLIMIT_NOFILE, (hard, hard))
        other.barrier()


def test_a_segment_that_busd_accepts_cannot_be_written_by_others() -> None:
    """The checks rely on seals, so test how the kernel enforces them."""
    ring = memfd()
    with pytest.raises(PermissionError):
        mmap.mmap(ring.fileno(), SIZE)
    with pytest.raises(OSError) as refused:
        os.ftruncate(ring.fileno(), 0)
    assert refused.value.errno == errno.EPERM
    assert Path(f"/proc/self/fd/{ring.fileno()}").readlink().name.startswith("memfd:busd-test")
