"""The broker enforces the rules of access, and says so at both ends and in the log."""

from typing import Any

import pytest

from broker_world import NUMBER, TEXT, UID, Process, Refusal, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.access import Access, AccessRule, Action
from busd.core.limits import Limits

ALICE, BOB = 1001, 1002
PUBLISH: tuple[Action, ...] = ("publish",)
SUBSCRIBE: tuple[Action, ...] = ("subscribe",)
OBSERVE: tuple[Action, ...] = ("observe",)


def rule(topics: str, actions: tuple[Action, ...], uid: int = ALICE, **fields: Any) -> AccessRule:
    return AccessRule(topics=(topics,), actions=frozenset(actions), uids=frozenset({uid}), **fields)


def renew(world: World, *rules: AccessRule) -> None:
    """Act like a SIGHUP with other rules."""
    world.carry_out(
        world.broker.reconfigure(world.now_ns, world.broker.settings.limits, (), Access(UID, tuple(rules)))
    )


def names(graph: m.GraphSnapshot) -> tuple[set[str], set[str], int]:
    """The names of nodes, the topics, and the number of matches."""
    return {one.name for one in graph.nodes}, {one.topic for one in graph.endpoints}, len(graph.matches)


def own_name(process: Process) -> str:
    """The name of a process's own node."""
    return f"node_{process.id}"


def graph_of(process: Process) -> m.GraphSnapshot:
    return process.request(m.GetGraph(request=0), m.GraphSnapshot)


class TestDeclaring:
    def test_what_is_allowed_works(self) -> None:
        world = World(access=(rule("/a", PUBLISH), rule("/b", SUBSCRIBE)))
        own, alice = world.process(), world.process("guest", uid=ALICE)
        heard, told = own.subscription("/a"), alice.subscription("/b")
        alice.publisher("/a").publish("hello")
        own.publisher("/b").publish("world")
        assert (heard.payloads, told.payloads) == (["hello"], ["world"])

    @pytest.mark.parametrize("kind", ["publisher", "subscription"])
    def test_what_is_denied_is_refused_and_named(self, kind: str) -> None:
        world = World(access=(rule("/a", ("observe",)),))
        alice = world.process("guest", uid=ALICE)
        with pytest.raises(Refusal) as caught:
            getattr(alice, kind)("/a")
        what = "publish on" if kind == "publisher" else "subscribe to"
        text = f"user 1001 may not {what} '/a': no rule of [[access]] in busd.toml allows it"
        assert (caught.value.answer.denied, caught.value.answer.text) == (True, text)
        assert caught.value.answer.resource == ""
        assert not world.broker.graph.topics
        assert [note for note in world.notes if text in note and "guest (pid" in note]

    @pytest.mark.parametrize("kind", ["publisher", "subscription"])
    def test_the_other_end_learns_of_it_once(self, kind: str) -> None:
        world = World(access=(rule("/z", OBSERVE),))
        own, alice = world.process(), world.process(uid=ALICE)
        same = own.publisher("/a") if kind == "publisher" else own.subscription("/a")
        other = own.subscription("/a") if kind == "publisher" else own.publisher("/a")
        for _ in range(3):
            with pytest.raises(Refusal):
                getattr(alice, kind)("/a")
        (told,) = own.got(m.Incompatible)
        assert (told.endpoint, told.policy, told.topic) == (other.id, "ACCESS", "/a")
        assert "user 1001 may not" in told.text and told.node == f"/{own_name(alice)}"
        assert told.endpoint != same.id
        assert sum("may not" in note for note in world.notes) == 1

    def test_the_log_is_bounded(self) -> None:
        world = World(access=(rule("/z", OBSERVE), rule("/z", OBSERVE, BOB)))
        alice = world.process(uid=ALICE)
        for number in range(2000):
            with pytest.raises(Refusal):
                alice.publisher(f"/t{number}")
            if not number % 500:
                world.advance(5)  # the limit of declarations is not the subject here
                alice.tell(m.Ping())
        lines = [note for note in world.notes if "may not publish" in note]
        assert len(lines) == 1024 and "no more denials of user 1001 are logged" in lines[-1]
        with pytest.raises(Refusal):
            world.process(uid=BOB).publisher("/t0")
        assert "user 1002 may not publish" in world.notes[-1]

    def test_a_service_needs_its_two_topics(self) -> None:
        world = World(access=(rule("/add/_request", SUBSCRIBE), rule("/add/_reply", PUBLISH)))
        alice = world.process(uid=ALICE)
        alice.subscription("/add/_request")
        alice.publisher("/add/_reply")
        with pytest.raises(Refusal):
            alice.publisher("/add/_request")


class TestSharing:
    @pytest.mark.parametrize("says", [(), ("guests",)], ids=["", "of an earlier version"])
    def test_processes_of_one_user_share_and_others_never(self, says: tuple[str, ...]) -> None:
        """This is true for every user. A program of an earlier version says that it would share."""
        users = (UID, 0, ALICE, BOB)
        both = ("publish", "subscribe")
        world = World(access=(rule("/a", both), rule("/a", both, BOB)))  # type: ignore[arg-type]
        talkers = [world.process(uid=uid, shares=True, capabilities=says).publisher("/a") for uid in users]
        for uid in users:
            process = world.process(uid=uid, shares=True, capabilities=says)
            subscription = process.subscription("/a")
            routes = {one.other: (one.route, one.descriptors) for one in subscription.got(m.Matched)}
            assert [routes[talker.id] for talker in talkers] == [
                ("shm", 2) if uid == other else ("socket", 0) for other in users
            ]
            own = talkers[users.index(uid)]
            given = [handles for message, handles in process.carried if isinstance(message, m.Matched)]
            assert given == [[own.ring, f"doorbell {own.process.id}"]]
            subscription.attach(own)
        for talker in talkers:
            assert len(talker.got(m.Attached)) == 1

    def test_whatever_the_rules_say(self) -> None:
        world = World(access=(rule("/a", ("publish", "subscribe")),))
        world.process(uid=ALICE, shares=True).publisher("/a")
        subscription = world.process(uid=ALICE, shares=True).subscription("/a")
        assert [one.route for one in subscription.got(m.Matched)] == ["shm"]


class TestObserving:
    def world(self) -> tuple[World, Process, Process]:
        """An own process with /seen and /hidden, and Alice, who may observe /seen and subscribe to
        /hidden.
        """
        world = World(access=(rule("/seen", OBSERVE), rule("/hidden", SUBSCRIBE)))
        own, alice = world.process(), world.process(uid=ALICE)
        own.publisher("/seen")
        own.subscription("/seen")
        own.publisher("/hidden", kind=NUMBER)
        return world, own, alice

    def test_the_graph_has_what_may_be_seen_and_what_is_ones_own(self) -> None:
        world, own, alice = self.world()
        world.process().subscription("/hidden")
        assert names(graph_of(alice)) == ({own_name(own)}, {"/seen"}, 1)
        mine = alice.subscription("/hidden", kind=NUMBER)
        graph = graph_of(alice)
        assert names(graph) == ({own_name(own), own_name(alice)}, {"/seen", "/hidden"}, 1)
        assert [one.id for one in graph.endpoints if one.topic == "/hidden"] == [mine.id]
        assert len(graph_of(own).nodes) > len(graph.nodes)

    @pytest.mark.parametrize("kind", ["publisher", "subscription"])
    def test_limits_tell_nothing_of_what_is_hidden(self, kind: str) -> None:
        """A denial is the same, whether or not the topic has too many endpoints for the limit of matches."""
        world = World(Limits(matches_per_peer=1), access=(rule("/seen", (*PUBLISH, *SUBSCRIBE)),))
        own, alice = world.process(), world.process(uid=ALICE)
        for _ in range(2):
            getattr(own, "subscription" if kind == "publisher" else "publisher")("/hidden")
        alice.publisher("/seen"), alice.subscription("/seen")
        for topic in ("/hidden", "/nothing"):
            with pytest.raises(Refusal) as caught:
                getattr(alice, kind)(topic)
            assert (caught.value.answer.denied, caught.value.answer.resource) == (True, "")

    def test_types_are_told_of_what_is_seen(self) -> None:
        _, _, alice = self.world()
        alice.request(m.GetType(request=0, type_name=TEXT[0], type_hash=TEXT[1]), m.TypeDescription)
        with pytest.raises(Refusal, match="no endpoint has the type"):
            alice.request(m.GetType(request=0, type_name=NUMBER[0], type_hash=NUMBER[1]), m.TypeDescription)

    def test_changes_that_are_not_seen_leave_the_revision(self) -> None:
        _, own, alice = self.world()
        before = alice.request(m.Observe(request=0), m.GraphSnapshot).revision
        own.publisher("/hidden2")
        (change,) = alice.got(m.GraphChanged)
        assert change == m.GraphChanged(revision=before + 1)


class TestOtherRules:
    def test_who_has_what_is_denied_is_cut_off_and_told(self) -> None:
        world = World(access=(rule("/a", PUBLISH), rule("/b", PUBLISH)))
        own, alice = world.process(), world.process(uid=ALICE)
        subscription = own.subscription("/a")
        alice.publisher("/a")
        alice.publisher("/b")
        renew(world, rule("/b", PUBLISH))
        assert alice.cut_reason is not None and "may not publish on '/a'" in alice.cut_reason
        assert alice.got(m.Fault)[0].text == alice.cut_reason
        assert len(subscription.got(m.Unmatched)) == 1
        again = world.process(uid=ALICE)
        again.publisher("/b")
        with pytest.raises(Refusal):
            again.publisher("/a")

    def test_who_may_nothing_any_more_is_cut_off_without_an_endpoint(self) -> None:
        world = World(access=(rule("/a", PUBLISH),))
        alice = world.process(uid=ALICE)
        renew(world)
        assert alice.cut_reason is not None and "its access rules have changed" in alice.cut_reason
        assert world.broker.entrance.why_turned_away(ALICE, frozenset({ALICE}))

    def test_others_are_left_alone(self) -> None:
        world = World(access=(rule("/a", PUBLISH), rule("/a", PUBLISH, BOB)))
        own, root, bob = world.process(), world.process(uid=0), world.process(uid=BOB)
        for process in (own, root, bob):
            process.publisher("/a")
        renew(world, rule("/a", PUBLISH, BOB))
        assert [one.cut_reason for one in (own, root, bob)] == [None] * 3

    def test_a_guest_is_asked_in_turns_of_its_own(self) -> None:
        """A guest with any number of endpoints has its own turns. busd asks nothing more about a guest that
        leaves meanwhile.
        """
        world = World(access=(rule("/**", (*PUBLISH, *OBSERVE)),))
        own, alice, bob = world.process(), world.process(uid=ALICE), world.process(uid=ALICE)
        for number in range(200):
            own.publisher(f"/own/n{number}")
            for guest in (alice, bob):
                guest.publisher(f"/guest/n{number}")
        for guest in (alice, bob):
            guest.request(m.Observe(request=0), m.GraphSnapshot)
        world.broker.meter.left = 20
        rules = (rule("/guest/**", PUBLISH), rule("/own/n1??", OBSERVE))
        effects = world.broker.reconfigure(world.now_ns, world.broker.settings.limits, (), Access(UID, rules))
        assert world.broker.meter.left > 0 and len(effects) == 2
        world.broker.go_on(world.now_ns, bob.id)
        bob.die()
        world.carry_out(effects)
        own_topics = {f"/guest/n{number}" for number in range(200)}
        assert alice.cut_reason is None
        assert names(graph_of(alice))[1] == own_topics | {f"/own/n{number}" for number in range(100, 200)}

    def test_the_same_rules_ask_for_no_endpoint(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """With many endpoints of guests, that would take half a second."""
        world = World(access=(rule("/a", PUBLISH),))
        world.process(uid=ALICE).publisher("/a")
        asked: list[tuple[object, ...]] = []
        monkeypatch.setattr(Access, "decide", lambda *what: asked.append(what))
        renew(world, rule("/a", PUBLISH))
        assert asked == []

    def test_what_is_seen_changes_with_the_rules(self) -> None:
        world = World(access=(rule("/a", OBSERVE),))
        own, alice = world.process(), world.process(uid=ALICE)
        own.publisher("/a")
        own.publisher("/b")
        free = world.process()
        seen = alice.request(m.Observe(request=0), m.GraphSnapshot)
        all_seen = free.request(m.Observe(request=0), m.GraphSnapshot)
        assert names(seen)[1] == {"/a"}
        renew(world, rule("/b", OBSERVE))
        (change,) = alice.got(m.GraphChanged)
        assert change.revision == seen.revision + 1
        assert [one.topic for one in change.endpoints_added] == ["/b"]
        assert [*change.endpoints_removed] == [one.id for one in seen.endpoints]
        assert not change.nodes_added and not change.nodes_removed
        assert free.got(m.GraphChanged) == []
        own.publisher("/c")
        assert [one.revision for one in free.got(m.GraphChanged)] == [all_seen.revision + 2]
        assert names(graph_of(alice))[1] == {"/b"}


class TestIdentity:
    def test_nobody_passes_as_another_users_publisher(self) -> None:
        """Alice takes the gid of a publisher of ours, which she can read in the graph."""
        world = World(access=(rule("/a", PUBLISH),))
        own, alice = world.process(), world.process(uid=ALICE)
        subscription = own.subscription("/a")
        mine = own.publisher("/a")
        hers = alice.publisher("/a", gid=mine.gid)
        first, second = (one.gid for one in subscription.got(m.Matched))
        assert first == mine.gid and second != mine.gid and len(second) == 16
        for publisher in (mine, hers):
            publisher.publish("x")
        assert subscription.payloads == ["x", "x"]
        graph = own.graph()
        assert {one.gid for one in graph.endpoints if one.kind == "publisher"} == {first, second}

    def test_who_comes_back_is_known_again(self) -> None:
        """At the next busd, too: the gid that others see depends on her own gid and on her user."""
        seen = []
        for _ in range(2):
            world = World(access=(rule("/a", PUBLISH), rule("/a", PUBLISH, BOB)))
            subscription = world.process().subscription("/a")
            for uid in (ALICE, BOB):
                world.process(uid=uid).publisher("/a", gid=b"a gid of hers   ")
            seen.append([one.gid for one in subscription.got(m.Matched)])
        assert seen[0] == seen[1] and len({*seen[0]}) == 2

    def test_nobody_describes_another_users_types(self) -> None:
        world = World(access=(rule("/a", ("publish", "observe")),))
        alice, own = world.process(uid=ALICE), world.process()
        alice.tell(m.DeclareType(type_name=TEXT[0], type_hash=TEXT[1], schema=b"lies"))
        own.tell(m.DeclareType(type_name=TEXT[0], type_hash=TEXT[1], schema=b"truth"))
        alice.tell(m.DeclareType(type_name=TEXT[0], type_hash=TEXT[1], schema=b"more lies"))
        asked = own.request(m.GetType(request=0, type_name=TEXT[0], type_hash=TEXT[1]), m.TypeDescription)
        assert asked.schema == b"truth"

    def test_types_that_others_do_not_have_they_describe_as_long_as_they_are_there(self) -> None:
        world = World(access=(rule("/a", ("publish", "observe")),))
        own, alice = world.process(), world.process(uid=ALICE)
        alice.tell(m.DeclareType(type_name=TEXT[0], type_hash=TEXT[1], schema=b"hers"))
        asks = m.GetType(request=0, type_name=TEXT[0], type_hash=TEXT[1])
        assert own.request(asks, m.TypeDescription).schema == b"hers"
        alice.die()
        with pytest.raises(Refusal, match="no endpoint has the type"):
            own.request(asks, m.TypeDescription)


def test_the_door() -> None:
    world = World(access=(rule("/a", PUBLISH),))
    assert world.broker.entrance.why_turned_away(ALICE, frozenset()) == ""
    assert world.broker.entrance.why_turned_away(UID, frozenset()) == ""
    assert "user 1002" in world.broker.entrance.why_turned_away(BOB, frozenset({BOB}))


def test_qos_is_no_matter_of_access() -> None:
    world = World(access=(rule("/a", PUBLISH),))
    own, alice = world.process(), world.process(uid=ALICE)
    own.subscription("/a", QoSProfile(reliability="reliable"))
    alice.publisher("/a", QoSProfile(reliability="best_effort"))
    assert [one.policy for one in own.got(m.Incompatible)] == ["RELIABILITY"]
