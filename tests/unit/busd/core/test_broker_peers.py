"""busd.core.broker: processes connect, send requests, break the rules and leave."""

import gc

import pytest

from broker_world import SECOND, TEXT, UID, Process, Refusal, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.absent import KEEP_NS, LOG_AGAIN_NS
from busd.core.access import Access
from busd.core.entities import Peer
from busd.core.limits import Limits
from rows import for_each


def assert_nothing_is_left(world: World) -> None:
    broker, graph = world.broker, world.broker.graph
    assert broker._peers == world.processes == {}
    tables = (graph.nodes, graph.publishers, graph.subscriptions, graph.topics, graph.types.trusted)
    assert not any(tables)
    world.advance(world.broker.settings.limits.lease_s + 1)
    # Busd keeps records for this time, for endpoints that may come back.
    world.advance((KEEP_NS + LOG_AGAIN_NS) / SECOND)
    assert broker.next_deadline_ns() is None, "timers hold what they look at"


class TestRequests:
    def test_pong_carries_the_number(self) -> None:
        process = World().process()
        process.tell(m.Ping(number=7))
        assert process.got(m.Pong) == [m.Pong(number=7)]

    def test_a_mere_sign_of_life_is_not_answered(self) -> None:
        process = World().process()
        process.tell(m.Ping())
        assert process.got(m.Pong) == []

    def test_a_pong_is_welcome(self) -> None:
        process = World().process()
        process.tell(m.Pong(number=1))
        assert process.cut_reason is None

    def test_the_pid_of_the_broker(self) -> None:
        assert World().process().graph().pid == 1

    def test_what_a_process_calls_itself_can_be_shown_on_any_terminal(self) -> None:
        world = World()
        world.process("\x1b[2Jné\nbus\u202e" + "x" * 100)
        (peer,) = world.process("").request(m.GetPeers(request=0), m.Peers).peers[:1]
        assert peer.program == "?[2Jné?bus?" + "x" * 53

    def test_a_schema_of_somebody_else(self) -> None:
        world = World()
        one, other = world.process(), world.process()
        one.declare_type(TEXT)
        answer = other.request(m.GetType(request=0, type_name=TEXT[0], type_hash=TEXT[1]), m.TypeDescription)
        assert bytes(answer.schema) == b"\xc0"

    def test_a_schema_that_nobody_has(self) -> None:
        with pytest.raises(Refusal, match=r"no endpoint has the type a \(b\)"):
            World().process().request(m.GetType(request=0, type_name="a", type_hash="b"), m.TypeDescription)

    @pytest.mark.parametrize("uid", [0, 1000])
    def test_the_owner_and_root_may_stop_it(self, uid: int) -> None:
        world = World()
        world.process("tool", uid=uid).request(m.StopBroker(request=0), m.Done)
        assert world.stop_reason == "asked by tool (pid 100)"

    def test_where_users_cant_be_told_the_sockets_mode_decides(self) -> None:
        world = World()
        world.process("tool", uid=-1).request(m.StopBroker(request=0), m.Done)
        assert world.stop_reason == "asked by tool (pid 100)"

    def test_others_may_not_stop_it(self) -> None:
        world = World()
        with pytest.raises(Refusal, match="user 1001 may not stop the busd of user 1000"):
            world.process(uid=1001).request(m.StopBroker(request=0), m.Done)
        assert world.stop_reason is None

    @pytest.mark.parametrize(
        ("message", "what"),
        [(m.StopBroker(request=0, restart=True), "restart"), (m.Reload(request=0), "reload")],
        ids=["restart", "reload"],
    )
    def test_nor_have_it_changed(self, message: m.Message, what: str) -> None:
        world = World()
        with pytest.raises(Refusal, match=f"user 1001 may not {what} the busd of user 1000"):
            world.process(uid=1001).request(message, m.Done)

    def test_a_process_that_has_gone_is_not_heard(self) -> None:
        world = World()
        process = world.process()
        process.die()
        assert world.broker.handle(world.now_ns, process.id, m.Ping()) == []
        assert world.broker.detach(world.now_ns, process.id) == []


class TestGoing:
    def crowded(self) -> tuple[World, list[Process]]:
        world = World(Limits(lease_s=2.0))
        processes = [world.process(f"process {at}") for at in range(3)]
        kept = QoSProfile(
            depth=5, durability="transient_local", liveliness_lease_duration=3600.0, lifespan=60.0
        )
        everything = QoSProfile(history="keep_all")
        for process in processes:
            for topic in ("/a", "/b", "/only_here"):
                process.subscription(topic, QoSProfile(depth=2))
                process.subscription(topic, everything)
                process.publisher(topic, kept).publish("x", "y", "z")
                process.publisher(topic, everything).publish("x", "y", "z")
            process.request(m.Observe(request=0), m.GraphSnapshot)
        processes[0].is_blocked = True
        for _ in range(20):
            processes[1].publisher("/a", kept).publish("1", "2", "3")
        return world, processes

    def test_nothing_is_left_of_the_dead(self) -> None:
        world, processes = self.crowded()
        peers = [world.broker._peers[process.id] for process in processes]
        for process in processes:
            process.die()
        assert_nothing_is_left(world)
        assert [(peer.queued.used, peer.history.used) for peer in peers] == [(0, 0)] * 3
        assert not any(peer.nodes or peer.endpoints or peer.lapsed for peer in peers)

    def test_nothing_is_left_of_what_was_destroyed(self) -> None:
        world, processes = self.crowded()
        for process in processes:
            process.is_blocked = False
            process.tell(m.DestroyNode(node=process._own_node().id))
        graph = world.broker.graph
        assert not any((graph.nodes, graph.publishers, graph.subscriptions, graph.topics))
        for process in processes:
            peer = world.broker._peers[process.id]
            assert (peer.queued.used, peer.history.used) == (0, 0)

    def test_timers_of_long_leases_do_not_pile_up(self) -> None:
        """The broker must not hold a publisher that has gone until its lease of a day is over."""
        world = World(Limits(lease_s=2.0))
        process = world.process()
        for _ in range(50):
            process.publisher("/a", QoSProfile(liveliness_lease_duration=86_400.0)).destroy()
        process.die()
        assert_nothing_is_left(world)

    def test_processes_that_come_and_go_do_not_pile_up(self) -> None:
        """Nothing waits until the lease of a process that has left is over."""
        world = World()
        gc.collect()
        gc.disable()
        try:
            for _ in range(50):
                world.process("passer-by").die()
                world.advance(0.1)
            kept = [one for one in gc.get_objects() if isinstance(one, Peer) and one.program == "passer-by"]
        finally:
            gc.enable()
        assert kept == []
        assert len(world.broker.timers._heap) == 1

    def test_nor_beside_one_with_a_long_lease(self) -> None:
        world = World(Limits(lease_s=3600.0))
        world.process("patient")
        world.broker.reconfigure(world.now_ns, Limits(lease_s=1.0), (), Access(UID, ()))
        for _ in range(50):
            world.process("passer-by").die()
            world.advance(1.1)
        assert len(world.broker.timers._heap) <= 2

    def test_types_stay_while_one_process_has_them(self) -> None:
        world = World()
        one, other = world.process(), world.process()
        one.declare_type(TEXT)
        other.declare_type(TEXT)
        one.die()
        assert TEXT in world.broker.graph.types.trusted
        other.die()
        assert TEXT not in world.broker.graph.types.trusted


MISTAKES = {
    "an endpoint that never was": m.DestroyEndpoint(endpoint=999),
    "an endpoint of another": m.DestroyEndpoint(endpoint=2),
    "a negative endpoint": m.DestroyEndpoint(endpoint=-1),
    "a node that never was": m.DestroyNode(node=999),
    "a node of another": m.DestroyNode(node=1),
    "a node for an endpoint": m.DestroyEndpoint(endpoint=1),
    "a report about another's": m.Report(endpoint=2, samples=1, bytes=1),
    "life of another's publisher": m.AssertLiveliness(publisher=2),
    "life of a subscription": m.AssertLiveliness(publisher=5),
    "an ack for another's": m.Ack(subscription=3, source=2, seq=1),
    "an ack for a publisher": m.Ack(subscription=6, source=2, seq=1),
    "a node of another for an endpoint": m.CreatePublisher(
        request=1, node=1, topic="/t", type_name=TEXT[0], type_hash=TEXT[1], qos=QoSProfile(), gid=bytes(16)
    ),
    "a type that was not declared": m.CreateSubscription(
        request=1, node=4, topic="/t", type_name="new", type_hash="new", qos=QoSProfile(), gid=bytes(16)
    ),
    "a short gid": m.CreateSubscription(
        request=1, node=4, topic="/t", type_name=TEXT[0], type_hash=TEXT[1], qos=QoSProfile(), gid=bytes(15)
    ),
    "a type without a name": m.DeclareType(type_name="", type_hash="a"),
    "a type with a long name": m.DeclareType(type_name="a" * 256, type_hash="a"),
    "a type with a long hash": m.DeclareType(type_name="a", type_hash="a" * 256),
}


class TestMistakes:
    """busd tells a process that breaks the protocol why, and cuts it off. No other process notices."""

    def world(self) -> tuple[World, Process, Process]:
        world = World()
        victim, offender = world.process("victim"), world.process("offender")
        publisher, subscription = victim.publisher("/t"), victim.subscription("/t")
        mine, offered = offender.subscription("/t"), offender.publisher("/t")
        assert [publisher.id, subscription.id, mine.id, offered.id] == [2, 3, 5, 6], "as MISTAKES says"
        return world, victim, offender

    @for_each("message", MISTAKES.values())
    def test_it_is_cut_off(self, message: m.Message) -> None:
        world, victim, offender = self.world()
        offender.tell(message)
        assert offender.cut_reason
        assert offender.messages[-1] == m.Fault(text=offender.cut_reason)
        assert offender.id not in world.processes
        assert len(world.broker.graph.nodes) == 1
        assert victim.cut_reason is None
        victim.publisher("/t").publish("still works")
        assert "still works" in victim.samples[3][-1].payload

    def test_everybody_is_told_once(self) -> None:
        world, victim, offender = self.world()
        victim.request(m.Observe(request=0), m.GraphSnapshot)
        offender.tell(m.DestroyEndpoint(endpoint=999))
        assert len(offender.got(m.Fault)) == 1
        assert len([note for note in world.notes if "cut off" in note]) == 1
        assert len(victim.got(m.GraphChanged)) == 1
        gone = [told.other for told in victim.got(m.Unmatched)]
        assert sorted(gone) == [5, 6]

    def test_what_it_sends_after_is_not_heard(self) -> None:
        world, _, offender = self.world()
        offender.send_bytes(
            m.encode_frame(m.DestroyNode(node=999)) + m.encode_frame(m.CreateNode(request=9, name="ghost"))
        )
        assert not any(node.name == "ghost" for node in world.broker.graph.nodes.values())

    @for_each("garbage", [b"\xff" * 8, m.encode_frame(m.Hello(version=1)), b"\x04\0\0\0\x01\0\0\0"])
    def test_bytes_that_are_no_message(self, garbage: bytes) -> None:
        world, victim, offender = self.world()
        offender.send_bytes(garbage)
        assert offender.got(m.Fault)
        assert len(world.broker.graph.nodes) == 1
        assert len(victim.got(m.Unmatched)) == 2
