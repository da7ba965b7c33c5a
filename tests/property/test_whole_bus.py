"""Random stories of clients and the broker back to back: each message arrives, waits, or was dropped, once.

In the client world (`tests/world/client_world.py`) nothing happens by itself. Each event is a step of the
story:

- a turn of a client's event loop, a read of the broker, a blocked socket
- a lost connection, a killed client, a match that leaves its ring, a new busd

So any order of events is possible.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import cycle, islice, product
from typing import Any, TypeAlias

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bus import shm
from bus.diagnostics import provoked
from bus.qos import QoSProfile, check_compatible
from bus.wire import messages as m
from busd.core.limits import Limits
from client_world import Client, ClientWorld
from effort import examples

STORIES = int(os.environ.get("BUSD_TESTS_STORIES", "0"))
"""The number of random stories to play; 0: always the same stories."""

PLAYED = settings(
    max_examples=STORIES or examples(180),
    derandomize=not STORIES,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)

Step: TypeAlias = tuple[Any, ...]
LOSSLESS = QoSProfile(history="keep_all")
PROFILES = [
    QoSProfile(1),
    QoSProfile(3),
    QoSProfile(10),
    LOSSLESS,
    QoSProfile(3, reliability="best_effort"),
    QoSProfile(3, durability="transient_local"),
    QoSProfile(history="keep_all", durability="transient_local"),
]
LARGE = "x" * 5_000
NARROW = Limits(keep_all_window_messages=8)
"""A window that publishers of the stories fill."""
LEASE_S = NARROW.lease_s
FAR, FURTHER = m.Origin("zenoh", "far"), m.Origin("zenoh", "near", via=("further",))

numbers = st.integers(0, 5)
profiles = st.sampled_from(PROFILES)
beginnings = st.tuples(
    st.lists(st.booleans(), min_size=2, max_size=3),
    st.lists(st.tuples(numbers, profiles), min_size=1, max_size=3),
    st.lists(st.tuples(numbers, profiles), min_size=1, max_size=2),
)
Beginning: TypeAlias = tuple[list[bool], list[tuple[int, QoSProfile]], list[tuple[int, QoSProfile]]]
"""Clients that share memory; then subscriptions and publishers, each with its client and QoS."""
bridgings = st.tuples(
    st.lists(st.sampled_from([None, FAR, FURTHER]), min_size=3, max_size=3),
    st.lists(st.sampled_from(["", "tap", "mirror", "local only"]), min_size=3, max_size=3),
)
Bridging: TypeAlias = tuple[list[Any], list[str]]
"""Origins of clients, and roles of subscriptions."""

calm = [
    st.tuples(st.just("publish"), numbers, st.integers(1, 6), st.sampled_from(["", "", LARGE])),
    st.tuples(st.just("publish"), numbers, st.integers(1, 3), st.just("")),
    st.tuples(st.just("take"), numbers, st.integers(1, 6)),
    st.tuples(st.just("step"), numbers),
    st.tuples(st.just("serve"), numbers),
    st.tuples(st.just("settle")),
    st.tuples(st.just("refuse"), numbers, numbers),
    st.tuples(st.just("choke"), numbers),
    st.tuples(st.just("block"), numbers),
    st.tuples(st.just("trickle"), numbers, st.integers(1, 4)),
    st.tuples(st.just("advance"), st.sampled_from([0.001, 0.03, 1.0, 11.0])),
]
cuts = [
    st.tuples(st.just("hang_up"), numbers),
    st.tuples(st.just("connect"), numbers),
    st.tuples(st.just("connect"), numbers),
    st.tuples(st.just("restart")),
]
ends = [
    st.tuples(st.just("die"), numbers),
    st.tuples(st.just("close_publisher"), numbers),
    st.tuples(st.just("close_subscription"), numbers),
]
restarts = [st.tuples(st.just("restart")), st.tuples(st.just("return_all")), st.tuples(st.just("return_all"))]
turns = st.lists(
    st.sampled_from([(word, at) for word in ("serve", "step") for at in (0, 1, 2)] + [("take", 0, 2)]),
    max_size=25,
)
returns = [
    st.tuples(st.just("publish"), st.just(0), st.integers(1, 3), st.just("")),
    st.tuples(st.just("take_turns"), turns),
    st.tuples(st.just("restart_all"), st.permutations([0, 1, 2])),
    st.tuples(st.just("cut"), st.sampled_from([0, 2]), turns.map(lambda some: some[:3])),
]
"""Steps while a bus comes back: few turns between two cuts."""
holds = [st.tuples(st.just("hold"), numbers, numbers)]


class Story:
    """The world, the published messages of each publisher and the received messages of each subscription."""

    def __init__(
        self,
        beginning: Beginning,
        bridging: Bridging = ([None] * 3, [""] * 3),
        limits: Limits | None = None,
    ) -> None:
        shares, subscriptions, publishers = beginning
        origins, roles = bridging
        self.world = ClientWorld(limits)
        self.clients = [
            self.world.client(shares=one and shm.is_available(), origin=origin)
            for one, origin in zip(shares, origins, strict=False)
        ]
        self.mirrors: set[Any] = set()
        """Subscriptions that receive nothing here."""
        self.subscriptions: dict[Any, Client] = {}
        self.publishers: dict[Any, Client] = {}
        self.heard: dict[Any, list[tuple[int, int]]] = {}
        self.is_cut_off = False
        """Whether a running busd has cut off a client."""
        self.late: set[Any] = set()
        """Subscriptions that were away, or silent, for longer than the lease."""
        self._absent_s: dict[Client, float] = {}
        for (at, qos), role in zip(subscriptions, roles, strict=False):
            client = self.clients[at % len(self.clients)]
            more: Any = {"local_only": True} if role == "local only" else {"role": role}
            made = client.subscription(qos, **more)
            self.subscriptions[made], self.heard[made] = client, []
            if role == "mirror":
                self.mirrors.add(made)
        self.world.settle()
        for number, (at, qos) in enumerate(publishers):
            client = self.clients[at % len(self.clients)]
            gid = None if client.origin is None else number.to_bytes(16, "big")
            self.publishers[client.publisher(qos, gid=gid)] = client
        self.world.settle()

    def play(self, steps: list[Step]) -> None:
        for word, *more in steps:
            getattr(self, word)(*more)
        self.come_to_rest()
        self.check()
        for publisher, client in self.publishers.items():
            assert client.publish(publisher) == 1
            self.come_to_rest()
            newest = self.world.number_of(publisher._core), publisher.statistics().published
            for subscription in self.subscriptions.keys() - self.mirrors:
                if any(match.gid == publisher.gid for match in subscription.matches):
                    assert newest in self.heard[subscription]
        self.check()

    # --- steps

    def publish(self, at: int, count: int, padding: str) -> None:
        if self.publishers:
            publisher = pick(self.publishers, at)
            taken = self.publishers[publisher].publish(publisher, count, padding)
            assert taken == count or publisher.qos.is_lossless

    def take(self, at: int, most: int) -> None:
        if self.subscriptions:
            subscription = pick(self.subscriptions, at)
            self.heard[subscription] += self.subscriptions[subscription].take(subscription, most)

    def step(self, at: int) -> None:
        pick(self.clients, at).step()

    def serve(self, at: int) -> None:
        pick(self.clients, at).serve()

    def settle(self) -> None:
        self.world.settle()

    def advance(self, seconds: float) -> None:
        """Let time pass; a client that is away, or does not read or write, for the lease is too late."""
        for client in self.clients:
            connection = client.connection
            is_stuck = connection is not None and (client.is_choked or connection.is_blocked)
            if connection is None or connection.has_ended or is_stuck:
                self._absent_s[client] = self._absent_s.get(client, 0) + seconds
                if self._absent_s[client] >= LEASE_S - 1:
                    has_publishers = is_stuck and client in self.publishers.values()
                    self.late |= {
                        one for one, at in self.subscriptions.items() if at is client or has_publishers
                    }
            else:
                self._absent_s.pop(client, None)
        self.world.advance(seconds)

    def refuse(self, at: int, which: int) -> None:
        """Refuse the route for a reader of a ring."""
        readers = [
            (one, match)
            for one in self.subscriptions
            for match in one._core.matches.items()
            if match[1].route == "shm"
        ]
        if readers:
            subscription, (other, _) = pick(readers, at + which)
            refusal = m.RefuseRoute(endpoint=subscription._core.id, other=other, text="a test")
            self.subscriptions[subscription].send_about(subscription._core, refusal)

    def choke(self, at: int) -> None:
        client = pick(self.clients, at)
        if client.is_choked:
            client.unchoke()
        else:
            client.is_choked = True

    def block(self, at: int) -> None:
        connection = pick(self.clients, at).connection
        if connection is not None and not connection.has_ended:
            if connection.is_blocked:
                connection.unblock()
            else:
                connection.is_blocked = True

    def trickle(self, at: int, frames: int) -> None:
        """A full socket takes some of the frames."""
        connection = pick(self.clients, at).connection
        if connection is not None and connection.is_blocked and not connection.has_ended:
            for _ in range(frames):
                connection.trickle()

    def hang_up(self, at: int) -> None:
        client = pick(self.clients, at)
        if client.connection is not None:
            self.is_cut_off = True
            client.hang_up()

    def connect(self, at: int) -> None:
        client = pick(self.clients, at)
        client.notice_end()
        if client.connection is None:
            client.is_choked = False
            client.connect()

    def restart(self) -> None:
        self.world.restart_broker()

    def return_all(self) -> None:
        self.world.connect_all()

    def take_turns(self, turns: list[Step]) -> None:
        for word, *more in turns:
            getattr(self, word)(*more)

    def restart_all(self, order: list[int]) -> None:
        self.restart()
        for at in order:
            self.connect(at)

    def cut(self, at: int, turns: list[Step]) -> None:
        self.hang_up(at)
        self.take_turns(turns)
        self.connect(at)

    def die(self, at: int) -> None:
        """Kill a client and replace it; a bridge's new publishers have the old gids."""
        client = pick(self.clients, at)
        client.die()
        gone = [one for one, where in self.publishers.items() if where is client]
        for endpoints in (self.publishers, self.subscriptions):
            for endpoint in [one for one, where in endpoints.items() if where is client]:
                del endpoints[endpoint]
        new = self.world.client(shares=client.shm_context is not None, origin=client.origin)
        self.clients[self.clients.index(client)] = new
        if new.origin is not None:
            for one in gone:
                self.publishers[new.publisher(one.qos, gid=one.gid)] = new

    def hold(self, at: int, which: int) -> None:
        """A lossless subscription stops giving a publisher room, or starts again."""
        readers = [one for one in self.subscriptions if one.qos.is_lossless]
        if readers and self.publishers:
            subscription, gid = pick(readers, at), pick(self.publishers, which).gid
            if gid in subscription._core.held_back:
                subscription.release(gid)
            else:
                subscription.hold_back(gid)

    def close_publisher(self, at: int) -> None:
        if self.publishers:
            publisher = pick(self.publishers, at)
            self.publishers.pop(publisher).close(publisher)

    def close_subscription(self, at: int) -> None:
        if self.subscriptions:
            subscription = pick(self.subscriptions, at)
            self.subscriptions.pop(subscription).close(subscription)

    # --- checks

    def come_to_rest(self) -> None:
        """Connect all clients, let everything arrive, and take all queued messages."""
        world = self.world
        for client in self.clients:
            if client.is_choked:
                client.unchoke()
            if client.connection is not None and client.connection.is_blocked:
                client.connection.unblock()
        for subscription in self.subscriptions:
            for gid in subscription._core.held_back:
                subscription.release(gid)
        world.settle()
        world.connect_all()
        world.advance(15)
        for _ in range(20):  # a keep-all publisher continues after each take
            before = sum(map(len, self.heard.values()))
            for subscription, client in self.subscriptions.items():
                self.heard[subscription] += client.take(subscription)
            world.advance(1)
            if sum(map(len, self.heard.values())) == before:
                return
        raise AssertionError("there is always more")

    def check_matches(self) -> None:
        """Compatible endpoints match; messages from a bus do not go back there."""
        for publisher, there in self.publishers.items():
            for subscription, here in self.subscriptions.items():
                if check_compatible(publisher.qos, subscription.qos):
                    continue
                mine, its = here.origin, there.origin
                is_of_one_bus = mine is not None and its is not None and mine.buses & its.buses
                is_matched = any(match.gid == publisher.gid for match in subscription.matches)
                is_tap = subscription._core._role == "tap"
                if is_tap and publisher.qos.is_lossless is not subscription.qos.is_lossless:
                    assert not is_matched
                else:
                    is_kept_out = is_of_one_bus or (subscription._core._local_only and its is not None)
                    assert is_matched is not bool(is_kept_out)
                is_counted = any(match.gid == subscription.gid for match in publisher.matches)
                assert is_counted is (is_matched and not is_tap)

    def check(self) -> None:
        assert not any(client.errors for client in self.clients)
        graph = self.world.whole_graph(statistics=True)
        records = {one.gid: one.statistics for one in graph.endpoints}
        for heard in self.heard.values():
            newest: dict[int, int] = {}
            for publisher, number in heard:
                assert number > newest.get(publisher, 0), "once, and in order"
                newest[publisher] = number
        for subscription in self.subscriptions:
            heard, totals = self.heard[subscription], subscription.statistics()
            assert (totals.delivered, totals.queued) == (len(heard), 0)
            assert not (subscription in self.mirrors and totals.expected)
            assert totals.expected == totals.delivered + sum(totals.dropped.values()), totals
            found = records[subscription.gid]
            assert found is not None
            told = found.samples, found.expected, found.dropped
            assert told == (totals.delivered, totals.expected, totals.dropped), (told, totals)
            if not self.is_cut_off:
                assert self.gaps(heard) <= sum(totals.dropped.values()), (heard, totals)

    def gaps(self, heard: list[tuple[int, int]]) -> int:
        """The number of gaps in the sequence numbers of existing publishers."""
        found = 0
        for number in [self.world.number_of(publisher._core) for publisher in self.publishers]:
            its = [one for publisher, one in heard if publisher == number]
            found += its[-1] + 1 - its[0] - len(its) if its else 0
        return found


class LastingStory(Story):
    """Endpoints stay: if both ends keep all, a subscription that is back within the lease loses nothing."""

    def check(self) -> None:
        super().check()
        for subscription in self.subscriptions.keys() - self.mirrors:
            matched = {match.gid for match in subscription.matches}
            publishers = [one for one in self.publishers if one.gid in matched]
            published = sum(one.statistics().published for one in publishers)
            totals = subscription.statistics()
            if subscription.qos.is_lossless and all(one.qos.is_lossless for one in publishers):
                if subscription in self.late:
                    assert {*totals.dropped} <= {"disconnected"}, totals
                else:
                    assert (totals.delivered, totals.dropped) == (published, {}), totals
            self.compare(totals.expected, published)

    def compare(self, expected: int, published: int) -> None:
        # A subscription without any message yet may not know samples in transit at the end of a connection.
        assert expected <= published


class CalmStory(LastingStory):
    """No connection ends: all published messages were expected."""

    def compare(self, expected: int, published: int) -> None:
        assert expected == published


def pick(among: Any, at: int) -> Any:
    ordered = [*among]
    return ordered[at % len(ordered)]


@contextmanager
def told(story: Story) -> Iterator[None]:
    try:
        yield
    finally:
        story.world.close()
        ClientWorld.all_open.remove(story.world)


@pytest.mark.parametrize(
    ("kind", "steps"),
    [
        (CalmStory, calm),
        (LastingStory, calm + restarts),
        (LastingStory, calm + cuts),
        (Story, calm + cuts + ends),
    ],
    ids=["calm", "restarts", "cuts", "everything"],
)
def test_each_message_is_accounted_for_once(
    kind: type[Story], steps: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(provoked, "_is_within_bounds", lambda *_: True)  # their bounds are per event loop

    @PLAYED
    @given(beginnings, st.sampled_from([None, NARROW]), st.lists(st.one_of(steps), max_size=40))
    def play(beginning: Beginning, limits: Limits | None, story: list[Step]) -> None:
        played = kind(beginning, limits=limits)
        with told(played):
            played.play(story)

    play()


@pytest.mark.parametrize(
    ("kind", "steps"),
    [(CalmStory, calm), (LastingStory, calm + cuts), (Story, calm + cuts + ends)],
    ids=["calm", "cuts", "everything"],
)
def test_it_is_with_bridges_too(kind: type[Story], steps: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Some clients come from other buses, with mirrors and taps; endpoints that return keep their gids."""
    monkeypatch.setattr(provoked, "_is_within_bounds", lambda *_: True)

    @PLAYED
    @given(
        beginnings,
        bridgings,
        st.sampled_from([None, NARROW]),
        st.lists(st.one_of(steps + holds), max_size=40),
    )
    def play(beginning: Beginning, bridging: Bridging, limits: Limits | None, story: list[Step]) -> None:
        played = kind(beginning, bridging, limits)
        with told(played):
            played.play(story)
            played.check_matches()

    play()


def test_lossless_streams_by_both_routes_when_the_bus_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """One of the two subscriptions gets its samples by socket, the other possibly by the publisher's ring."""
    monkeypatch.setattr(provoked, "_is_within_bounds", lambda *_: True)
    subscriptions = [(0, LOSSLESS), (1, LOSSLESS)]

    @PLAYED
    @given(
        st.sampled_from([[False, True, True], [False, False, True], [False, False, False]]),
        st.sampled_from([None, NARROW]),
        st.lists(st.one_of(returns), min_size=2, max_size=12),
    )
    def play(shares: list[bool], limits: Limits | None, story: list[Step]) -> None:
        played = LastingStory((shares, subscriptions, [(2, LOSSLESS)]), limits=limits)
        with told(played):
            played.play(story)

    play()


def test_what_was_dropped_before_a_cut_and_comes_again_counts_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """By socket: queues replace messages, and histories bring them again."""
    monkeypatch.setattr(provoked, "_is_within_bounds", lambda *_: True)
    kept = [QoSProfile(depth, durability="transient_local") for depth in (1, 3, 20)]
    ends = st.lists(st.tuples(numbers, st.sampled_from([*kept, QoSProfile(3)])), min_size=1, max_size=2)

    @PLAYED
    @given(st.tuples(st.just([False] * 3), ends, ends), st.lists(st.one_of([*calm, *cuts]), max_size=40))
    def play(beginning: Beginning, story: list[Step]) -> None:
        played = LastingStory(beginning)
        with told(played):
            played.play(story)

    play()


@pytest.mark.parametrize("shares", [(False, False, True), (False, True, True)])
@pytest.mark.parametrize("whose", [0, 2], ids=["subscription", "publisher"])
def test_a_cut_at_each_turn_of_a_return(shares: tuple[bool, ...], whose: int) -> None:
    """busd was killed, and one end is cut off during its return: a lossless stream loses nothing."""
    order: list[Step] = [("serve", 2), ("serve", 0), ("step", 2), ("step", 0)]
    for number in range(32):
        turns = [*islice(cycle(order), number)]
        story = LastingStory(([*shares], [(0, LOSSLESS), (1, LOSSLESS)], [(2, LOSSLESS)]), limits=NARROW)
        with told(story):
            begin: list[Step] = [("publish", 0, 2, ""), ("settle",), ("publish", 0, 3, ""), ("step", 2)]
            story.play([*begin, ("restart_all", [0, 1, 2]), ("take_turns", turns), ("cut", whose, [])])


@pytest.mark.parametrize("whose", ["subscription", "publisher"])
@pytest.mark.parametrize("limits", [None, NARROW], ids=["wide", "narrow"])
def test_what_is_on_its_way_when_a_connection_is_lost(whose: str, limits: Limits | None) -> None:
    """A sample of a lossless stream by socket arrives, whichever end was cut off."""
    story = LastingStory(([False, False], [(0, LOSSLESS)], [(1, LOSSLESS)]), limits=limits)
    with told(story):
        hang_up = ("hang_up", ["subscription", "publisher"].index(whose))
        story.play([("publish", 0, 3, ""), hang_up, ("publish", 0, 6, "")])
        (subscription,) = story.subscriptions
        assert subscription.statistics().dropped == {}


@pytest.mark.parametrize("qos", [LOSSLESS, QoSProfile(10, durability="transient_local")])
def test_a_publisher_that_was_lost_too_comes_back_and_leaves(qos: QoSProfile) -> None:
    """Samples published in between are received, and not lost, although busd waited for the publisher."""
    story = Story(([False, False], [(0, qos)], [(1, qos)]))
    with told(story):
        begin: list[Step] = [("publish", 0, 1, ""), ("settle",), ("take", 0, 1)]
        cuts: list[Step] = [("hang_up", 0), ("hang_up", 1), ("connect", 0), ("settle",), ("connect", 1)]
        end: list[Step] = [("settle",), ("publish", 0, 3, ""), ("settle",), ("take", 0, 3)]
        story.play([*begin, *cuts, *end, ("close_publisher", 0), ("advance", 11.0)])
        (subscription,) = story.subscriptions
        totals = subscription.statistics()
        assert (totals.delivered, totals.dropped) == (4, {})


@pytest.mark.parametrize("depth", [1, 2])
def test_what_a_publisher_replaced_when_busd_is_lost_before_it_says_so(depth: int) -> None:
    """The subscription existed before, so all missing samples were for it."""
    story = LastingStory(([False, False], [(0, QoSProfile(100))], [(1, QoSProfile(depth))]))
    with told(story):
        begin: list[Step] = [
            ("publish", 0, 1, ""),
            ("settle",),
            ("take", 0, 9),
            ("restart",),
            ("return_all",),
        ]
        flood: list[Step] = [("choke", 1), *[("publish", 0, 3, ""), ("step", 1)] * 3, ("choke", 1)]
        pass_on: list[Step] = [("step", 1), ("serve", 1), ("step", 0), ("take", 0, 9)]
        story.play([*begin, *flood, *pass_on, ("restart",), ("return_all",)])
        (subscription,) = story.subscriptions
        assert subscription.statistics().dropped == {"disconnected": story.gaps(story.heard[subscription])}
        assert story.gaps(story.heard[subscription])


EVENTS: list[Step] = [
    ("hang_up", 0),
    ("hang_up", 2),
    ("restart",),
    ("connect", 0),
    ("serve", 2),
    ("publish", 0, 2, ""),
]


@pytest.mark.parametrize("shares", [(False, False, False), (False, False, True), (False, True, True)])
def test_all_short_stories_of_cuts(shares: tuple[bool, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """A lossless publisher and two subscriptions; two events in any order, or three with STORIES."""
    monkeypatch.setattr(provoked, "_is_within_bounds", lambda *_: True)
    beginning: Beginning = [*shares], [(0, LOSSLESS), (1, LOSSLESS)], [(2, LOSSLESS)]
    for events in product(EVENTS, repeat=3 if STORIES else 2):
        for end in ([], [("publish", 0, 3, ""), ("hang_up", 0), ("publish", 0, 2, "")]):
            story = LastingStory(beginning, limits=NARROW)
            with told(story):
                story.play([("publish", 0, 3, ""), *events, *end])
