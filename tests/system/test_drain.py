"""A busd that stops in order: it delivers all received samples, and sends queued ones to readers."""

import signal
import socket
from collections.abc import Callable

import pytest

from bus.wire import messages as m
from bus.wire.layout import LEAVING, PROTOCOL_VERSION
from bus.wire.runs import Run
from conftest import WAIT_S, Daemon
from neighbours import wait_until, with_limits
from nursery import state
from raw_peer import RawPeer, data, text

POLITE = m.Hello(version=PROTOCOL_VERSION, capabilities=(LEAVING,), program="polite peer")
LONG_S = 3600
"""Far longer than a test may take: a test that waits for it hangs."""


def words(peer: RawPeer) -> list[str]:
    """The last letters of all samples up to the end of the connection."""
    return [
        str(bytes(payload)[-1:], "ascii")
        for item in peer.until_end()
        if isinstance(item, Run)
        for payload, _ in item.records()
    ]


def stopped_while(daemon: Daemon, action: Callable[[], None]) -> None:
    """Runs `action` while busd is stopped, so that busd then finds its effect and a SIGTERM together."""
    daemon.process.send_signal(signal.SIGSTOP)
    wait_until(lambda: state(daemon.pid) == "T")
    action()
    daemon.process.terminate()
    daemon.process.send_signal(signal.SIGCONT)


class TestWhatWasSent:
    def test_arrives(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as talker, RawPeer(daemon.path) as listener:
            listener.hello().subscription(listener.node(), "/t")
            publisher = talker.hello().publisher(talker.node(), "/t").id
            talker.barrier()
            frames = [data(publisher, text(letter), first_seq=at) for at, letter in enumerate("abc", 1)]
            stopped_while(daemon, lambda: talker.write(b"".join(frames)))
            assert words(listener) == ["a", "b", "c"]
        assert daemon.process.wait(WAIT_S) == 0

    def test_arrives_also_of_one_that_has_gone(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as talker, RawPeer(daemon.path) as listener:
            listener.hello().subscription(listener.node(), "/t")
            publisher = talker.hello().publisher(talker.node(), "/t").id
            talker.barrier()

            def write_and_go() -> None:
                talker.write(data(publisher, text("a")))
                talker.close()

            stopped_while(daemon, write_and_go)
            assert words(listener) == ["a"]

    @with_limits(drain_s=LONG_S)
    def test_a_frame_that_has_begun_is_ended(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as talker, RawPeer(daemon.path) as listener:
            listener.hello().subscription(listener.node(), "/t")
            talker.send(POLITE)
            talker.expect(m.Hello)
            publisher = talker.publisher(talker.node(), "/t").id
            talker.barrier()
            frame = data(publisher, text("a"))
            talker.write(frame[:40])
            daemon.process.terminate()
            assert talker.expect(m.Leaving).text == "busd stops: SIGTERM"
            talker.write(frame[40:])
            talker.socket.shutdown(socket.SHUT_WR)
            assert words(listener) == ["a"]
            assert talker.receive() is None

    @with_limits(drain_s=1.0)
    def test_one_that_does_not_heed_holds_nobody_up(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as deaf, RawPeer(daemon.path) as listener:
            deaf.send(POLITE)
            deaf.expect(m.Hello)
            listener.hello().subscription(listener.node(), "/t")
            deaf.write(data(deaf.publisher(deaf.node(), "/t").id, text("a")))
            deaf.barrier()
            daemon.process.terminate()
            assert words(listener) == ["a"]
            assert daemon.process.wait(WAIT_S) == 0
        assert "does not read" not in daemon.log.read_text()


class TestWhatWaits:
    @with_limits(drain_s=LONG_S)
    def test_is_sent_to_one_that_reads_late(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as talker, RawPeer(daemon.path) as listener:
            listener.hello().subscription(listener.node(), "/t")
            publisher = talker.hello().publisher(talker.node(), "/t").id
            long = "x" * (1 << 20)
            for at, letter in enumerate("abcde", 1):
                talker.write(data(publisher, text(long + letter), first_seq=at))
            talker.barrier()
            daemon.process.terminate()
            assert talker.receive() is None  # busd has closed connections without queued messages
            assert daemon.process.poll() is None
            assert words(listener) == [*"abcde"]
        assert daemon.process.wait(WAIT_S) == 0

    @with_limits(drain_s=LONG_S)
    def test_what_was_dropped_is_told(self, daemon: Daemon) -> None:
        """Usually busd reports drops a little later, several at once."""
        with RawPeer(daemon.path) as talker, RawPeer(daemon.path) as listener:
            subscription = listener.hello().subscription(listener.node(), "/t").id
            publisher = talker.hello().publisher(talker.node(), "/t").id
            talker.barrier()
            stopped_while(daemon, lambda: talker.write(data(publisher, text("z"), first_seq=8)))
            said = [item for item in listener.until_end() if isinstance(item, m.Dropped)]
        assert said == [m.Dropped(subscription=subscription, dropped={"publisher_queue": 7})]

    @with_limits(drain_s=0.1)
    def test_is_left_where_nobody_reads(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as sleeper, RawPeer(daemon.path) as talker:
            sleeper.hello().subscription(sleeper.node(), "/t")
            publisher = talker.hello().publisher(talker.node(), "/t").id
            long = "x" * (1 << 20)
            for at in range(1, 6):
                talker.write(data(publisher, text(long), first_seq=at))
            talker.barrier()
            daemon.process.terminate()
            assert daemon.process.wait(WAIT_S) == 0
        (left,) = [line for line in daemon.log.read_text().splitlines() if "does not read" in line]
        assert left.endswith("samples were lost")

    @with_limits(drain_s=LONG_S)
    def test_a_second_signal_ends_it_at_once(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as sleeper, RawPeer(daemon.path) as talker:
            sleeper.hello().subscription(sleeper.node(), "/t")
            publisher = talker.hello().publisher(talker.node(), "/t").id
            for at in range(1, 6):
                talker.write(data(publisher, text("x" * (1 << 20)), first_seq=at))
            talker.barrier()
            daemon.process.terminate()
            assert talker.receive() is None
            daemon.process.send_signal(signal.SIGINT)
            assert daemon.process.wait(WAIT_S) == 0


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT], ids=lambda number: number.name)
def test_nobody_can_connect_meanwhile(daemon: Daemon, number: signal.Signals) -> None:
    """So another busd can start at once."""
    with RawPeer(daemon.path) as sleeper:
        sleeper.hello()
        daemon.process.send_signal(number)
        assert sleeper.receive() is None
        assert not daemon.path.exists()
