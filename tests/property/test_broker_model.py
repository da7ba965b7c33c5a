"""The broker against a naive model, and against the books: every sample is received, waiting, or counted."""

from collections import Counter
from typing import TypeVar

from broker_model import Model, ModelPublisher, ModelSubscription
from broker_world import NUMBER, TEXT, Process, Publisher, Subscription, World
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.runs import Run
from busd.core.limits import Limits

KIB = 1024

Chosen = TypeVar("Chosen")

# Weighted so that most endpoints match, and most queues are short.
topics = st.sampled_from(["/a", "/a", "/a", "/b"])
kinds = st.sampled_from([TEXT] * 7 + [NUMBER])
profiles = st.builds(
    QoSProfile,
    depth=st.sampled_from([1, 2, 3, 5]),
    history=st.sampled_from(["keep_last", "keep_last", "keep_last", "keep_all"]),
    reliability=st.sampled_from(["reliable", "reliable", "reliable", "best_effort"]),
    durability=st.sampled_from(["transient_local", "transient_local", "volatile"]),
    lifespan=st.sampled_from([None, None, 1.0, 3.0]),
)
indices = st.integers(0, 99)
bursts = st.lists(
    st.tuples(indices, st.integers(1, 6), st.sampled_from([0, 0, 0, 1, 4])), min_size=1, max_size=4
)


class Watcher:
    """A process that keeps its own copy of the graph, from a snapshot and what changed since."""

    def __init__(self, world: World) -> None:
        self.process = world.process("watcher")
        graph = self.process.request(m.Observe(request=0), m.Graph)
        self.revision = graph.revision
        self.nodes = {node.id: node for node in graph.nodes}
        self.endpoints = {endpoint.id: endpoint for endpoint in graph.endpoints}
        self.matches = Counter((match.publisher, match.subscription) for match in graph.matches)
        self._seen = 0

    def catch_up(self) -> None:
        changes = self.process.got(m.GraphChanged)
        for change in changes[self._seen :]:
            assert change.revision == self.revision + 1
            self.revision = change.revision
            self.nodes |= {node.id: node for node in change.nodes_added}
            self.endpoints |= {endpoint.id: endpoint for endpoint in change.endpoints_added}
            self.matches.update((match.publisher, match.subscription) for match in change.matches_added)
            self.matches.subtract((match.publisher, match.subscription) for match in change.matches_removed)
            for endpoint in change.endpoints_removed:
                del self.endpoints[endpoint]
            for node in change.nodes_removed:
                del self.nodes[node]
        self._seen = len(changes)


class Books(RuleBasedStateMachine):
    """Processes come, publish, block and die; the sums must be right whatever the limits are."""

    LIMITS = Limits(
        queued_bytes_per_peer=3 * KIB,
        history_bytes_per_peer=2 * KIB,
        message_bytes=KIB,
        keep_all_window_bytes=KIB,
        control_bytes_per_peer=KIB * KIB,
    )
    PADDING = 200

    def __init__(self) -> None:
        super().__init__()
        self.world = World(self.LIMITS)
        self.watcher = Watcher(self.world)
        self.processes: dict[int, Process] = {}
        self.publishers: dict[int, Publisher] = {}
        self.subscriptions: dict[int, Subscription] = {}
        self.model = Model()
        self.due: dict[int, int] = {}
        self.published = 0

        for _ in range(3):
            self.connect()

    # --- what happens

    @rule(at=indices, topic=topics, kind=kinds, qos=profiles)
    def create_publisher(self, at: int, topic: str, kind: tuple[str, str], qos: QoSProfile) -> None:
        process = self.pick(self.processes, at)
        made = process.publisher(topic, qos, kind=kind)
        self.publishers[made.id] = made
        self.model.add_publisher(ModelPublisher(made.id, process.id, topic, kind, qos, made.gid, made.next_seq))

    @rule(
        at=indices,
        topic=topics,
        kind=kinds,
        qos=profiles,
        known=st.dictionaries(indices, st.integers(0, 6), max_size=1),
    )
    def create_subscription(
        self, at: int, topic: str, kind: tuple[str, str], qos: QoSProfile, known: dict[int, int]
    ) -> None:
        process = self.pick(self.processes, at)
        last_seqs = {self.pick(self.publishers, one).gid: seq for one, seq in known.items() if self.publishers}
        made = process.subscription(topic, qos, kind=kind, last_seqs=last_seqs)
        self.subscriptions[made.id] = made
        subscription = ModelSubscription(made.id, process.id, topic, kind, qos)
        self.model.add_subscription(subscription, last_seqs, self.world.now_ns)
        self.due[made.id] = self.accounted(made.id)  # the histories that were there

    def publish(self, bursts: list[tuple[int, int, int]]) -> None:
        for at, number, lost in bursts if self.publishers else ():
            publisher = self.pick(self.publishers, at)
            payloads = [f"{self.published + one:{self.PADDING}}" for one in range(number)]
            self.published += number
            origin = self.model.publishers[publisher.id]
            self.model.publish(origin, lost, payloads, self.world.now_ns)
            for subscription in self.model.subscribers_of(origin):
                self.due[subscription.id] += lost + number
            publisher.lose(lost)
            publisher.publish(*payloads)

    publish_some = rule(bursts=bursts)(publish)
    publish_more = rule(bursts=bursts)(publish)

    @rule(at=indices)
    def block_or_unblock(self, at: int) -> None:
        process = self.pick(self.processes, at)
        if process.is_blocked:
            self.model.unblock(process.id, self.world.now_ns)
            process.unblock()
        else:
            self.model.blocked.add(process.id)
            process.is_blocked = True

    @rule(at=indices, how=st.sampled_from(["destroy", "destroy", "destroy the node", "die", "break the rules"]))
    def end(self, at: int, how: str) -> None:
        """The end of an endpoint, of all of a process, or of the process; then another takes its place."""
        endpoints = {**self.publishers, **self.subscriptions}
        if how == "destroy":
            if endpoints:
                endpoint = self.pick(endpoints, at)
                self.forget({endpoint.id})
                endpoint.destroy()
            return
        process = self.pick(self.processes, at)
        self.forget(self.model.endpoints_of(process.id))
        if how == "destroy the node":
            process._own_node().destroy()
            process._node = None
            return
        if how == "die":
            process.die()
        else:
            process.tell(m.DestroyNode(node=-1))
        del self.processes[process.id]
        self.model.blocked.discard(process.id)
        self.connect()

    @rule(seconds=st.sampled_from([0.1, 0.5, 2.0]))
    def wait(self, seconds: float) -> None:
        self.world.advance(seconds)
        for process in (self.watcher.process, *self.processes.values()):
            process.tell(m.Ping())

    # --- what holds

    @invariant()
    def nothing_is_lost_from_the_books(self) -> None:
        for number in self.subscriptions:
            assert self.accounted(number) == self.due[number]

    @invariant()
    def each_publishers_samples_come_once_and_in_order(self) -> None:
        for subscription in self.subscriptions.values():
            last: dict[int, int] = {}
            for sample in subscription.samples:
                assert sample.seq > last.get(sample.source, 0)
                last[sample.source] = sample.seq

    @invariant()
    def nobody_holds_more_than_his_quota(self) -> None:
        for number in self.processes:
            peer = self.world.broker._peers[number]
            queues = [one.queue for one in peer.endpoints.values() if hasattr(one, "queue")]
            histories = [one.history for one in peer.endpoints.values() if getattr(one, "history", None)]
            assert peer.queued.used == sum(queue.bytes for queue in queues) <= peer.queued.limit
            assert peer.history.used == sum(queue.bytes for queue in histories) <= peer.history.limit

    @invariant()
    def the_graph_is_right_and_known(self) -> None:
        graph = self.world.broker.graph.snapshot(0, statistics=False, pid=1)
        assert {(match.publisher, match.subscription) for match in graph.matches} == self.model.matches()
        assert {endpoint.id for endpoint in graph.endpoints} == {*self.publishers, *self.subscriptions}
        self.watcher.catch_up()
        assert self.watcher.revision == graph.revision
        assert self.watcher.nodes == {node.id: node for node in graph.nodes}
        assert self.watcher.endpoints == {endpoint.id: endpoint for endpoint in graph.endpoints}
        assert +self.watcher.matches == Counter(self.model.matches())

    def teardown(self) -> None:
        for process in (*self.processes.values(), self.watcher.process):
            process.die()
        graph = self.world.broker.graph
        assert not any((graph.nodes, graph.publishers, graph.subscriptions, graph.topics, graph.types))
        self.world.advance(self.LIMITS.lease_s)
        assert self.world.broker.next_deadline_ns() is None

    # --- helpers

    def connect(self) -> None:
        process = self.world.process()
        self.processes[process.id] = process

    def pick(self, among: dict[int, Chosen], at: int) -> Chosen:
        return among[sorted(among)[at % len(among)]]

    def forget(self, endpoints: set[int]) -> None:
        for number in endpoints:
            self.publishers.pop(number, None)
            self.subscriptions.pop(number, None)
            self.model.remove(number)

    def accounted(self, number: int) -> int:
        """Samples that a subscription received, that wait for it, and that were counted as dropped."""
        inside = self.world.broker.graph.subscriptions[number]
        return len(self.subscriptions[number].samples) + inside.queue.count + sum(inside.dropped.values())


class AgainstModel(Books):
    """With room for everything, each queue holds exactly what the naive model holds."""

    LIMITS = Limits()
    PADDING = 1

    @invariant()
    def every_queue_is_as_in_the_model(self) -> None:
        for number, subscription in self.subscriptions.items():
            model = self.model.subscriptions[number]
            inside = self.world.broker.graph.subscriptions[number]
            assert [one[:3] for one in subscription.samples] == [one[:3] for one in model.received]
            assert [one.is_replay for one in subscription.samples] == [one.is_replay for one in model.received]
            waiting = [
                (run.source, payload)
                for at, run in enumerate(inside.queue.runs)
                for payload in _payloads(run, inside.queue.skipped if at == 0 else 0)
            ]
            assert waiting == [(one.publisher, one.payload) for one in model.queue]
            assert inside.dropped == dict(+model.dropped)

    @invariant()
    def every_history_is_as_in_the_model(self) -> None:
        for number, publisher in self.model.publishers.items():
            history = self.world.broker.graph.publishers[number].history
            if history is not None:
                fresh = [one.seq for one in publisher.history]
                kept = [seq for run in history.newest(0, 0) for seq in range(run.first_seq, run.first_seq + run.count)]
                assert kept == fresh[len(fresh) - len(kept) :]


def _payloads(run: Run, skipped: int) -> list[str]:
    return [bytes(payload).decode() for payload, _ in run.records()][skipped:]


TestBooks = Books.TestCase
TestBooks.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)
TestAgainstModel = AgainstModel.TestCase
TestAgainstModel.settings = settings(max_examples=100, stateful_step_count=50, deadline=None)
