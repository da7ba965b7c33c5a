"""A user with limited rights to observe: the copy of the graph always equals the permitted part."""

from collections import Counter
from collections.abc import Sequence
from typing import Any, TypeAlias

from hypothesis import given, settings
from hypothesis import strategies as st

from broker_endpoints import Publisher, Subscription
from broker_world import UID, Process, World
from bus.wire import messages as m
from busd.core.access import Access, AccessRule
from busd.core.work import UNLIMITED
from effort import examples

ALICE = 1001
TOPICS = ("/a", "/b", "/c")

Step: TypeAlias = tuple[Any, ...]
indices = st.integers(0, 99)
observed = st.frozensets(st.sampled_from(TOPICS))
steps = st.one_of(
    st.tuples(st.just("create"), indices, st.booleans(), st.sampled_from(TOPICS)),
    st.tuples(st.just("create"), indices, st.booleans(), st.sampled_from(TOPICS)),
    st.tuples(st.just("destroy"), indices),
    st.tuples(st.just("destroy_node"), indices),
    st.tuples(st.just("refuse"), indices),
    st.tuples(st.just("die"), indices),
    st.tuples(st.just("renew"), observed),
    st.tuples(st.just("observe_again")),
)


def rules(seen: frozenset[str]) -> tuple[AccessRule, ...]:
    """Alice may publish and subscribe anywhere, and observe the topics in `seen`."""
    may: list[tuple[tuple[str, ...], str]] = [(TOPICS, "publish"), (TOPICS, "subscribe")]
    may += [((topic,), "observe") for topic in sorted(seen)]
    return tuple(
        AccessRule(
            topics=topics,
            actions=frozenset({action}),  # type: ignore[arg-type]
            uids=frozenset({ALICE}),
        )
        for topics, action in may
    )


class Copy:
    """An observer's copy of the graph, from a snapshot and changes."""

    def __init__(self, process: Process) -> None:
        self.process = process
        self.observe()

    def observe(self) -> None:
        graph = self.process.request(m.Observe(request=0), m.GraphSnapshot)
        self.revision = graph.revision
        self.nodes = {one.id: one for one in graph.nodes}
        self.endpoints = {one.id: one for one in graph.endpoints}
        self.matches = Counter(graph.matches)
        self._seen = len(self.process.got(m.GraphChanged))

    def catch_up(self) -> None:
        changes = self.process.got(m.GraphChanged)
        for change in changes[self._seen :]:
            assert change.revision > self.revision
            self.revision = change.revision
            parts: tuple[tuple[dict[int, Any], Sequence[Any], Sequence[int]], ...] = (
                (self.nodes, change.nodes_added, change.nodes_removed),
                (self.endpoints, change.endpoints_added, change.endpoints_removed),
            )
            for table, added, removed in parts:
                gone = {*removed} - {one.id for one in added}
                assert gone <= table.keys(), "what goes was told of"
                table |= {one.id: one for one in added}
                for number in removed:
                    del table[number]
            self.matches.update(change.matches_added)
            self.matches.subtract(change.matches_removed)
        self._seen = len(changes)


class Story:
    def __init__(self, seen: frozenset[str], budget: int) -> None:
        self.world = World(access=rules(seen))
        self.world.budget = budget
        self.seen = seen
        self.alice = Copy(self.world.process(uid=ALICE, shares=True))
        self.processes = [self.alice.process, *(self.world.process(shares=True) for _ in range(3))]
        self.endpoints: list[Publisher | Subscription] = []

    def play(self, steps: list[Step]) -> None:
        self.check()
        for name, *arguments in steps:
            getattr(self, name)(*arguments)
            self.check()

    def create(self, at: int, is_publisher: bool, topic: str) -> None:
        process = self.processes[at % len(self.processes)]
        self.endpoints.append(process.publisher(topic) if is_publisher else process.subscription(topic))

    def destroy(self, at: int) -> None:
        if self.endpoints:
            self.endpoints.pop(at % len(self.endpoints)).destroy()

    def destroy_node(self, at: int) -> None:
        process = self.processes[at % len(self.processes)]
        self.endpoints = [one for one in self.endpoints if one.process is not process]
        process._own_node().destroy()
        process._node = None

    def refuse(self, at: int) -> None:
        if self.endpoints:
            endpoint = self.endpoints[at % len(self.endpoints)]
            for matched in endpoint.got(m.Matched):
                message = m.RefuseRoute(endpoint=endpoint.id, other=matched.other, text="no")
                endpoint.process.tell(message)

    def die(self, at: int) -> None:
        number = 1 + at % (len(self.processes) - 1)  # not Alice
        process = self.processes[number]
        self.endpoints = [one for one in self.endpoints if one.process is not process]
        process.die()
        self.processes[number] = self.world.process(shares=True)

    def renew(self, seen: frozenset[str]) -> None:
        self.seen = seen
        world, broker = self.world, self.world.broker
        access = Access(UID, rules(seen))
        world.carry_out(broker.reconfigure(world.now_ns, broker.settings.limits, (), access))

    def observe_again(self) -> None:
        self.alice.observe()

    def check(self) -> None:
        """Compare with the whole graph, without any of the code that filters."""
        alice, broker = self.alice, self.world.broker
        whole = self.world.whole_graph()
        own = set(broker._peers[alice.process.id].nodes)
        endpoints = {one.id: one for one in whole.endpoints if one.topic in self.seen or one.node in own}
        shown = {one.node for one in endpoints.values()} | own
        nodes = {one.id: one for one in whole.nodes if one.id in shown}
        matches = Counter(
            one for one in whole.matches if one.publisher in endpoints and one.subscription in endpoints
        )
        alice.catch_up()
        assert (alice.revision, alice.nodes, alice.endpoints) == (whole.revision, nodes, endpoints)
        assert +alice.matches == matches and not -alice.matches
        asked = alice.process.graph()
        assert {one.id for one in asked.nodes} == {*nodes}
        assert {one.id for one in asked.endpoints} == {*endpoints}
        assert Counter(asked.matches) == matches


@settings(max_examples=examples(80), deadline=None)
@given(observed, st.lists(steps, min_size=10, max_size=40), st.sampled_from([UNLIMITED, 20]))
def test_the_copy_is_what_may_be_seen(seen: frozenset[str], story: list[Step], budget: int) -> None:
    Story(seen, budget).play(story)
