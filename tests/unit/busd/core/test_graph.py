"""busd.core.graph: the snapshot, and the changes that observers receive."""

from broker_line import Line
from broker_world import NUMBER, TEXT, Process, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import MAX_COUNT
from rows import for_each


def watching(world: World) -> tuple[Process, m.GraphSnapshot]:
    process = world.process("observer")
    return process, process.request(m.Observe(request=0), m.GraphSnapshot)


class TestSnapshot:
    def test_an_empty_one(self) -> None:
        graph = World().process().graph()
        assert (graph.revision, graph.nodes, graph.endpoints, graph.matches) == (0, (), (), ())

    def test_everything(self) -> None:
        world = World()
        talker, listener = world.process(), world.process()
        node = talker.node("talker", "/robot")
        publisher = node.publisher("/topic", QoSProfile(depth=3))
        subscription = listener.node("listener").subscription("/topic")
        other = node.subscription("/other", kind=NUMBER)
        graph = listener.graph()
        assert graph.nodes == (
            m.NodeRecord(id=node.id, name="talker", namespace="/robot", pid=100),
            m.NodeRecord(id=subscription.id - 1, name="listener", namespace="/", pid=101),
        )
        records = {record.id: record for record in graph.endpoints}
        assert records[publisher.id] == m.EndpointRecord(
            id=publisher.id,
            kind="publisher",
            node=node.id,
            topic="/topic",
            type_name=TEXT[0],
            type_hash=TEXT[1],
            gid=publisher.gid,
            qos=QoSProfile(depth=3),
        )
        assert records[other.id].kind == "subscription"
        assert records[other.id].type_name == NUMBER[0]
        assert graph.matches == (m.MatchRecord(publisher=publisher.id, subscription=subscription.id),)
        assert graph.revision > 0

    def test_statistics_only_where_asked_for(self) -> None:
        process = World().process()
        process.publisher("/topic")
        assert [record.statistics for record in process.graph().endpoints] == [None]
        assert [record.statistics for record in process.graph(statistics=True).endpoints] == [
            m.EndpointStatistics()
        ]

    def test_topics_live_as_long_as_an_endpoint(self) -> None:
        world = World()
        process = world.process()
        publisher, subscription = process.publisher("/topic"), process.subscription("/topic")
        publisher.destroy()
        assert "/topic" in world.broker.graph.topics
        subscription.destroy()
        assert "/topic" not in world.broker.graph.topics


class TestChanges:
    def test_one_for_each_change_and_numbered(self) -> None:
        world = World()
        observer, snapshot = watching(world)
        process = world.process()
        node = process.node("talker")
        publisher = node.publisher("/topic")
        subscription = node.subscription("/topic")
        match = m.MatchRecord(publisher=publisher.id, subscription=subscription.id)
        first, second, third = observer.got(m.GraphChanged)
        assert [one.revision - snapshot.revision for one in (first, second, third)] == [1, 2, 3]
        assert [record.name for record in first.nodes_added] == ["talker"]
        assert [record.id for record in second.endpoints_added] == [publisher.id]
        assert [record.id for record in third.endpoints_added] == [subscription.id]
        assert (second.matches_added, third.matches_added) == ((), (match,))
        process.die()
        gone = observer.got(m.GraphChanged)[3]
        assert gone.nodes_removed == (node.id,)
        assert sorted(gone.endpoints_removed) == [publisher.id, subscription.id]
        assert gone.matches_removed == (match,)

    def test_no_news_without_a_change(self) -> None:
        world = World()
        observer, _ = watching(world)
        process = world.process()
        process.declare_type(TEXT)
        process.tell(m.Ping())
        process.graph()
        world.process().die()
        assert observer.got(m.GraphChanged) == []

    def test_what_is_refused_changes_nothing(self) -> None:
        world = World()
        observer, _ = watching(world)
        world.process().tell(m.CreateNode(request=1, name="not a name"))
        assert observer.got(m.GraphChanged) == []

    def test_an_observer_sees_its_own_changes(self) -> None:
        observer, _ = watching(World())
        observer.node("mine")
        (change,) = observer.got(m.GraphChanged)
        assert [record.name for record in change.nodes_added] == ["mine"]

    def test_off_again(self) -> None:
        world = World()
        observer, _ = watching(world)
        observer.request(m.Observe(request=0, on=False), m.Done)
        world.process().node("unseen")
        assert observer.got(m.GraphChanged) == []

    def test_asked_twice_each_change_comes_once(self) -> None:
        world = World()
        observer, _ = watching(world)
        observer.request(m.Observe(request=0), m.GraphSnapshot)
        world.process().node("once")
        assert len(observer.got(m.GraphChanged)) == 1

    def test_an_observer_that_was_cut_off_is_forgotten(self) -> None:
        world = World()
        observer, _ = watching(world)
        other, _ = watching(world)
        observer.tell(m.DestroyNode(node=99))
        world.process().node("later")
        assert observer.got(m.GraphChanged) == []
        assert len(other.got(m.GraphChanged)) == 1


class TestStatistics:
    def test_of_a_publisher(self) -> None:
        line = Line()
        line.publisher.publish("four", "x")
        counted = line.publisher.statistics()
        assert (counted.samples, counted.bytes) == (2, 5), "bytes of messages, without the wire's headers"

    def test_the_process_knows_more_than_the_broker(self) -> None:
        """A publisher that lost samples itself, or was at another broker before, reports that."""
        line = Line()
        line.publisher.publish("x")
        line.talker.tell(m.Report(endpoint=line.publisher.id, samples=9, bytes=90, dropped={"replaced": 8}))
        assert line.publisher.statistics() == m.EndpointStatistics(
            samples=9, bytes=90, dropped={"replaced": 8}
        )

    def test_say_when_they_were_counted(self) -> None:
        line = Line()
        line.publisher.publish("x")
        here_ns = line.publisher.statistics().at_ns
        assert here_ns == line.world.now_ns, "what the broker has counted itself"
        line.talker.tell(m.Report(endpoint=line.publisher.id, samples=1, bytes=1, at_ns=here_ns - 5))
        assert line.publisher.statistics().at_ns == here_ns - 5, "what the process has counted"
        line.world.now_ns += 100
        line.publisher.publish("x")
        assert line.publisher.statistics().at_ns == here_ns + 100, "the broker has counted more since"

        assert line.subscription.statistics().at_ns == 0, "a process that does not say"
        line.listener.tell(m.Report(endpoint=line.subscription.id, samples=1, bytes=1, at_ns=7))
        assert line.subscription.statistics().at_ns == 7

    def test_of_a_subscription_both_parts_together(self) -> None:
        line = Line(requested=QoSProfile(depth=1))
        line.listener.is_blocked = True
        line.publisher.publish_many("abc")
        line.listener.tell(
            m.Report(
                endpoint=line.subscription.id,
                samples=7,
                bytes=70,
                queued=2,
                dropped={"replaced": 1, "undecodable": 1},
                expected=11,
                repeated=1,
            )
        )
        assert line.subscription.statistics(line.talker) == m.EndpointStatistics(
            samples=7,
            bytes=70,
            queued=3,
            dropped={"replaced": 3, "undecodable": 1},
            expected=13,
            most_missed=2,
        )

    @for_each("expected", [0, 5, MAX_COUNT])
    @for_each("repeated", [0, 9, MAX_COUNT])
    def test_whatever_a_process_says_of_itself_others_can_read_it(self, expected: int, repeated: int) -> None:
        line = Line()
        line.publisher.publish("x")
        number = line.subscription.id
        claim = m.Report(endpoint=number, samples=1, bytes=1, expected=expected, repeated=repeated)
        line.listener.tell(claim)
        found = line.subscription.statistics(line.talker)
        assert found.expected == min(max(1 + expected - repeated, 0), MAX_COUNT)
