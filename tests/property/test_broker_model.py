"""The broker against a naive model, and against the books: each sample is received, waiting, or counted."""

from collections import Counter
from collections.abc import Callable
from typing import Any, TypeAlias, TypeVar

from hypothesis import given, settings
from hypothesis import strategies as st

from broker_endpoints import Publisher, Subscription
from broker_model import Model, ModelPublisher, ModelSubscription
from broker_world import NUMBER, SECOND, TEXT, Process, World
from bus.base.ids import EndpointId
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.runs import Run
from busd.core import entities
from busd.core.absent import KEEP_NS, LOG_AGAIN_NS
from busd.core.limits import Limits
from busd.core.work import UNLIMITED
from effort import examples
from match_tables import check_matches

KIB = 1024

Chosen = TypeVar("Chosen")
Beginning: TypeAlias = tuple[QoSProfile, QoSProfile, bool, bool]
Step: TypeAlias = tuple[Any, ...]

# Weighted: most endpoints match, and most queues are short.
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
ends = st.sampled_from(["destroy", "destroy", "destroy the node", "die", "break the rules"])
known_seqs = st.dictionaries(indices, st.integers(0, 6), max_size=1)


def _step(name: str, *arguments: st.SearchStrategy[Any]) -> st.SearchStrategy[Step]:
    return st.tuples(st.just(name), *arguments)


publish = _step("publish", bursts)
steps = st.one_of(
    publish,
    publish,
    publish,
    _step("create_publisher", indices, topics, kinds, profiles),
    _step("create_subscription", indices, topics, kinds, profiles, known_seqs),
    _step("block_or_unblock", indices),
    _step("block_or_unblock", indices),
    _step("end", indices, ends),
    _step("attach", indices),
    _step("refuse", indices, st.booleans()),
    _step("catch_up", indices, st.integers(0, 3)),
    _step("grow", indices, st.sampled_from([True, True, True, False])),
    _step("wait", st.sampled_from([0.1, 0.5, 2.0])),
)
beginnings = st.lists(st.tuples(profiles, profiles, st.booleans(), st.booleans()), min_size=3, max_size=3)
stories = st.lists(steps, min_size=15, max_size=40)
budgets = st.sampled_from([UNLIMITED, 20])
"""The broker's budget for work at a time: dividing work must not change the results."""


class Watcher:
    """A process that keeps a copy of the graph, from a snapshot and later changes."""

    def __init__(self, world: World) -> None:
        self.process = world.process("watcher")
        graph = self.process.request(m.Observe(request=0), m.GraphSnapshot)
        self.revision = graph.revision
        self.nodes = {node.id: node for node in graph.nodes}
        self.endpoints = {endpoint.id: endpoint for endpoint in graph.endpoints}
        self.matches = Counter(graph.matches)
        self._seen = 0

    def catch_up(self) -> None:
        changes = self.process.got(m.GraphChanged)
        for change in changes[self._seen :]:
            assert change.revision == self.revision + 1
            self.revision = change.revision
            self.nodes |= {node.id: node for node in change.nodes_added}
            self.endpoints |= {endpoint.id: endpoint for endpoint in change.endpoints_added}
            self.matches.update(change.matches_added)
            self.matches.subtract(change.matches_removed)
            for endpoint in change.endpoints_removed:
                del self.endpoints[endpoint]
            for node in change.nodes_removed:
                del self.nodes[node]
        self._seen = len(changes)


class Books:
    """Processes come, publish, block and die; for any limits, the sums must be right."""

    LIMITS = Limits(
        queued_bytes_per_peer=2 * KIB,
        history_bytes_per_peer=2 * KIB,
        message_bytes=KIB,
        keep_all_window_bytes=KIB,
        control_bytes_per_peer=KIB * KIB,
    )
    PADDING = 200

    def __init__(self, beginning: list[Beginning], budget: int) -> None:
        """Each process begins with a publisher and a subscription; some share memory, some don't read."""
        self.world = World(self.LIMITS)
        self.world.budget = budget
        self.watcher = Watcher(self.world)
        self.processes: dict[int, Process] = {}
        self.publishers: dict[int, Publisher] = {}
        self.subscriptions: dict[int, Subscription] = {}
        self.model = Model()
        self.due: dict[int, int] = {}
        self.published = 0
        self.attached: set[tuple[int, int]] = set()
        for at, (offered, requested, is_blocked, shares) in enumerate(beginning):
            self.connect(shares=shares)
            self.create_publisher(at, "/a", TEXT, offered)
            self.create_subscription(at, "/a", TEXT, requested, {})
            if is_blocked:
                self.block_or_unblock(at)

    def play(self, story: list[Step]) -> None:
        """Do each step, and check everything after each."""
        self.check()
        for name, *arguments in story:
            step: Callable[..., None] = getattr(self, name)
            step(*arguments)
            self.check()
        self.close()

    def check(self) -> None:
        self.check_books()
        self.check_order()
        self.check_quotas()
        self.check_graph()

    # --- steps

    def create_publisher(self, at: int, topic: str, kind: tuple[str, str], qos: QoSProfile) -> None:
        process = self.pick(self.processes, at)
        made = process.publisher(topic, qos, kind=kind)
        self.publishers[made.id] = made
        self.model.add_publisher(
            ModelPublisher(made.id, process.id, topic, kind, qos, made.gid, made.next_seq, process.shares)
        )

    def create_subscription(
        self, at: int, topic: str, kind: tuple[str, str], qos: QoSProfile, known: dict[int, int]
    ) -> None:
        process = self.pick(self.processes, at)
        heard = {self.pick(self.publishers, one): seq for one, seq in known.items() if self.publishers}
        last_seqs = {one.gid: min(seq, one.next_seq - 1) for one, seq in heard.items()}
        made = process.subscription(topic, qos, kind=kind, last_seqs=last_seqs)
        self.subscriptions[made.id] = made
        subscription = ModelSubscription(made.id, process.id, topic, kind, qos)
        self.model.add_subscription(subscription, last_seqs, self.world.now_ns)
        self.due[made.id] = self.accounted(made.id)  # samples of the existing histories

    def publish(self, bursts: list[tuple[int, int, int]]) -> None:
        for at, number, lost in bursts if self.publishers else ():
            publisher = self.pick(self.publishers, at)
            payloads = [f"{self.published + one:{self.PADDING}}" for one in range(number)]
            self.published += number
            origin = self.model.publishers[publisher.id]
            # A publisher with a ring skips no number: samples missing here went by the ring.
            lost, gone = (0, lost) if origin.has_ring else (lost, 0)
            if origin.elsewhere:  # after one catch-up it sends everything from there on
                lost = gone = 0
            elsewhere = self.model.publish(origin, lost, gone, payloads, self.world.now_ns)
            for subscription in self.model.subscribers_of(origin):
                self.due[subscription.id] += lost + number
                self.due[subscription.id] += elsewhere * (publisher.id in subscription.returned)
            publisher.lose(lost)
            if gone:
                publisher.resume(publisher.next_seq + gone)
            publisher.publish(*payloads)

    def attach(self, at: int) -> None:
        waiting = {ends: ends for ends in sorted(self.model.shared - self.attached)}
        if waiting:
            ends = self.pick(waiting, at)
            self.attached.add(ends)
            publisher, subscription = self.publishers[ends[0]], self.subscriptions[ends[1]]
            subscription.attach(publisher)
            if not publisher.process.is_blocked:
                assert publisher.got(m.Attached)[-1].subscription == subscription.id

    def refuse(self, at: int, by_publisher: bool) -> None:
        if self.model.shared:
            publisher, subscription = self.pick({ends: ends for ends in sorted(self.model.shared)}, at)
            self.reroute(publisher, subscription)
            if by_publisher:
                self.publishers[publisher].refuse(self.subscriptions[subscription])
            else:
                self.subscriptions[subscription].refuse(self.publishers[publisher])

    def catch_up(self, at: int, number: int) -> None:
        """Send a subscription the samples that the others got by their rings."""
        left = [
            ends for ends in sorted(self.model.late) if not self.subscriptions[ends[1]].process.is_blocked
        ]
        if left:
            ends = self.pick({ends: ends for ends in left}, at)
            publisher, subscription = self.publishers[ends[0]], self.subscriptions[ends[1]]
            payloads = [f"{self.published + one:{self.PADDING}}" for one in range(number)]
            self.published += number
            self.due[subscription.id] += number
            origin, reader = self.model.publishers[publisher.id], self.model.subscriptions[subscription.id]
            self.model.catch_up(origin, reader, payloads, self.world.now_ns)
            publisher.catch_up(subscription, *payloads, first_seq=publisher.next_seq)
            publisher.resume(publisher.next_seq + number)

    def grow(self, at: int, is_ring_there: bool) -> None:
        publishers = {number: one for number, one in self.publishers.items() if one.process.shares}
        if publishers:
            publisher = self.pick(publishers, at)
            self.model.publishers[publisher.id].has_ring = is_ring_there
            if not is_ring_there:
                for source, reader in sorted(self.model.shared):
                    if source == publisher.id:
                        self.reroute(source, reader)
            message = m.ReplaceRing(publisher=publisher.id)
            publisher.process.tell(message, *["larger"] * is_ring_there)

    def reroute(self, publisher: int, subscription: int) -> None:
        self.model.reroute(self.model.publishers[publisher], self.model.subscriptions[subscription])

    def block_or_unblock(self, at: int) -> None:
        process = self.pick(self.processes, at)
        if process.is_blocked:
            self.model.unblock(process.id, self.world.now_ns)
            process.unblock()
        else:
            self.model.blocked.add(process.id)
            process.is_blocked = True

    def end(self, at: int, how: str) -> None:
        """End an endpoint, all endpoints of a process, or the process; a new process replaces it."""
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
        self.connect(shares=process.shares)

    def wait(self, seconds: float) -> None:
        self.world.advance(seconds)
        for process in (self.watcher.process, *self.processes.values()):
            process.tell(m.Ping())

    # --- checks

    def check_books(self) -> None:
        for number in self.subscriptions:
            assert self.accounted(number) == self.due[number]
            inside = self.world.broker.graph.subscriptions[EndpointId(number)]
            assert inside.expected == inside.statistics().expected == self.due[number]

    def check_order(self) -> None:
        for subscription in self.subscriptions.values():
            last: dict[int, int] = {}
            for sample in subscription.samples:
                assert sample.seq > last.get(sample.source, 0)
                last[sample.source] = sample.seq

    def check_quotas(self) -> None:
        for process in self.processes.values():
            peer = self.world.broker._peers[process.id]
            waiting = kept = 0
            for endpoint in peer.endpoints.values():
                if isinstance(endpoint, entities.Subscription):
                    waiting += endpoint.queue.held_bytes
                elif endpoint.history is not None:
                    kept += endpoint.history.held_bytes
            assert peer.queued.used == waiting <= peer.queued.limit
            assert peer.history.used == kept <= peer.history.limit

    def check_graph(self) -> None:
        graph = self.world.whole_graph()
        routes = {(match.publisher, match.subscription, match.route) for match in graph.matches}
        assert routes == self.model.matches()
        check_matches(self.world.broker.graph)
        assert {endpoint.id for endpoint in graph.endpoints} == {*self.publishers, *self.subscriptions}
        self.watcher.catch_up()
        assert self.watcher.revision == graph.revision
        assert self.watcher.nodes == {node.id: node for node in graph.nodes}
        assert self.watcher.endpoints == {endpoint.id: endpoint for endpoint in graph.endpoints}
        assert +self.watcher.matches == Counter(graph.matches)

    def close(self) -> None:
        """End all processes; nothing may be left."""
        for process in (*self.processes.values(), self.watcher.process):
            process.die()
        graph = self.world.broker.graph
        assert not any(
            (graph.nodes, graph.publishers, graph.subscriptions, graph.topics, graph.types.trusted)
        )
        self.world.advance(self.LIMITS.lease_s)
        self.world.advance((KEEP_NS + LOG_AGAIN_NS) / SECOND)  # records kept for processes that may come back
        assert self.world.broker.next_deadline_ns() is None

    # --- helpers

    def connect(self, *, shares: bool) -> None:
        process = self.world.process(shares=shares)
        self.processes[process.id] = process
        if shares:
            self.model.sharing.add(process.id)

    def pick(self, among: dict[Any, Chosen], at: int) -> Chosen:
        return among[sorted(among)[at % len(among)]]

    def forget(self, endpoints: set[int]) -> None:
        for number in endpoints:
            self.publishers.pop(number, None)
            self.subscriptions.pop(number, None)
            self.model.remove(number)

    def accounted(self, number: int) -> int:
        """Samples of a subscription: received, waiting, or counted as dropped."""
        inside = self.world.broker.graph.subscriptions[EndpointId(number)]
        return len(self.subscriptions[number].samples) + inside.queue.count + sum(inside.dropped.values())


class AgainstModel(Books):
    """With room for everything, each queue has exactly the content of the naive model's queue."""

    LIMITS = Limits()
    PADDING = 1

    def check(self) -> None:
        super().check()
        self.check_queues()
        self.check_histories()

    def check_queues(self) -> None:
        for number, subscription in self.subscriptions.items():
            model = self.model.subscriptions[number]
            inside = self.world.broker.graph.subscriptions[EndpointId(number)]
            assert [one[:3] for one in subscription.samples] == [one[:3] for one in model.received]
            assert [one.is_replay for one in subscription.samples] == [
                one.is_replay for one in model.received
            ]
            waiting = [
                (run.source, payload)
                for at, run in enumerate(inside.queue.runs)
                for payload in _payloads(run, inside.queue.skipped if at == 0 else 0)
            ]
            assert waiting == [(one.publisher, one.payload) for one in model.queue]
            assert inside.dropped == dict(+model.dropped)

    def check_histories(self) -> None:
        for number, publisher in self.model.publishers.items():
            history = self.world.broker.graph.publishers[EndpointId(number)].history
            if history is not None:
                fresh = [one.seq for one in publisher.history]
                kept = [
                    seq
                    for run in history.newest(0, 0)
                    for seq in range(run.first_seq, run.first_seq + run.count)
                ]
                assert kept == fresh[len(fresh) - len(kept) :]


def _payloads(run: Run, skipped: int) -> list[str]:
    return [bytes(payload).decode() for payload, _ in run.records()][skipped:]


@settings(max_examples=examples(60), deadline=None)
@given(beginnings, stories, budgets)
def test_the_books_are_right_when_memory_is_short(
    beginning: list[Beginning], story: list[Step], budget: int
) -> None:
    Books(beginning, budget).play(story)


@settings(max_examples=examples(100), deadline=None)
@given(beginnings, stories, budgets)
def test_against_the_model(beginning: list[Beginning], story: list[Step], budget: int) -> None:
    AgainstModel(beginning, budget).play(story)
