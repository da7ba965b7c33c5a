"""During long work, a real busd serves other clients: it answers their questions before the work is done."""

from contextlib import ExitStack

import pytest

from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.runs import Run
from conftest import Daemon
from neighbours import Neighbours
from raw_peer import STRING, RawPeer, data, text

MANY = 400
KEEP_ALL = QoSProfile(history="keep_all")


def endpoints(node: int, topic: str, number: int) -> bytes:
    """Publishers and subscriptions of one topic, in turn."""
    return b"".join(
        m.encode_frame(
            (m.CreatePublisher if at % 2 else m.CreateSubscription)(
                request=1000 + at,
                node=node,
                topic=topic,
                type_name=STRING.name,
                type_hash=STRING.hash,
                qos=QoSProfile(),
                gid=node.to_bytes(8, "big") + at.to_bytes(8, "big"),
            )
        )
        for at in range(number)
    )


class TestLongWork:
    """Each of these takes busd about a second."""

    def test_matches_are_made_and_unmade(self, daemon: Daemon, peer: RawPeer, other: RawPeer) -> None:
        node = peer.hello().node("many")
        peer.write(endpoints(node, "/many", MANY))
        answered = 0
        for _ in range(5):
            other.barrier()
            answered += 1
        created = set[int]()
        while peer.has_more and len(created) < MANY:
            message = peer.receive()
            if isinstance(message, m.Created):
                created.add(message.request)
        assert answered == 5 and len(created) < MANY  # it was far from done
        while len(created) < MANY:
            created.add(peer.expect(m.Created).request)
            other.barrier()
        peer.close()
        for _ in range(5):
            other.barrier()
        assert self.graph(other).matches  # busd is still removing it
        while self.graph(other).endpoints:
            pass

    def graph(self, peer: RawPeer) -> m.GraphSnapshot:
        answer: m.GraphSnapshot = peer.ask(m.GetGraph(request=peer.request()))
        return answer

    def peers(self, peer: RawPeer) -> int:
        answer: m.Peers = peer.ask(m.GetPeers(request=peer.request()))
        return len(answer.peers)

    def test_a_process_that_comes_back_finds_nothing_of_its_own(
        self, daemon: Daemon, peer: RawPeer, other: RawPeer
    ) -> None:
        """busd answers its questions after it has removed the earlier endpoints, so no one appears twice."""
        node = peer.hello().node("many")
        peer.write(endpoints(node, "/many", MANY))
        while peer.expect(m.Created).request != 1000 + MANY - 1:
            pass
        peer.close()
        with RawPeer(daemon.path) as again:
            graph: m.GraphSnapshot = again.hello().ask(m.GetGraph(request=1))
        assert not graph.endpoints

    def test_one_that_has_gone_with_all_its_connections(
        self, daemon: Daemon, peer: RawPeer, other: RawPeer
    ) -> None:
        """Its unread connections wait for the removal of its earlier endpoints, and not for each other."""
        with RawPeer(daemon.path) as first, RawPeer(daemon.path) as second:
            for one in (first, second):
                one.hello()
            node = peer.hello().node("many")
            peer.write(endpoints(node, "/many", MANY))
            while peer.expect(m.Created).request != 1000 + MANY - 1:
                pass
            other.barrier()
            peer.close()
            other.barrier()
            for one in (first, second):
                one.send(m.Ping(number=1))
        other.barrier()
        assert self.graph(other).matches  # busd was still removing it
        while self.peers(other) > 1:
            pass

    def test_one_that_takes_a_lot_is_never_cut_off(self, daemon: Daemon, peer: RawPeer) -> None:
        """It makes more matches than its queue may hold, and reads slowly, but it reads."""
        node = peer.hello().node("many")
        with ExitStack() as stack:
            more = [stack.enter_context(RawPeer(daemon.path)).hello() for _ in range(2)]
            nodes = [one.node("more") for one in more]
            for one, number in zip([peer, *more], [node, *nodes], strict=True):
                one.write(endpoints(number, "/many", 100))
            last = dict.fromkeys([peer, *more], 0)
            while min(last.values()) < 1099:
                for one in last:
                    if one.has_more:
                        last[one] = max(last[one], getattr(one.receive(), "request", 0))


class TestFloods:
    """Endless frames, each of them allowed; neighbours lose nothing and get answers."""

    @pytest.mark.parametrize("what", ["acks", "reports", "attachments", "questions", "pings", "samples"])
    def test_one_kind_of_frame(
        self, daemon: Daemon, peer: RawPeer, other: RawPeer, neighbours: Neighbours, what: str
    ) -> None:
        node = peer.hello().node("flood")
        publisher = peer.publisher(node, "/flood", qos=KEEP_ALL).id
        subscription = peer.subscription(node, "/flood", qos=KEEP_ALL).id
        peer.write(data(publisher, text("x")))
        peer.expect(Run)
        frame = {
            "acks": m.encode_frame(m.Ack(subscription=subscription, source=publisher, seq=1)),
            "reports": m.encode_frame(m.Report(endpoint=subscription, samples=1, bytes=1)),
            "attachments": m.encode_frame(m.Attach(subscription=subscription, source=publisher, slot=0)),
            "questions": m.encode_frame(m.GetGraph(request=1)),
            "pings": m.encode_frame(m.Ping(number=1)),
            "samples": b"",
        }[what]
        flood = frame * 5000 or b"".join(data(publisher, text("y"), first_seq=2 + at) for at in range(5000))
        sent = 0
        for _ in range(20):
            sent += peer.write_some(flood[sent:]) if sent < len(flood) else 0
            other.barrier()
            while peer.has_more:
                assert peer.receive() is not None
