"""busd.core.quotas: the limits of a process and of all processes of a user, and the texts at these limits."""

import gc

import pytest

from broker_world import ALL_MAY, SECOND, TEXT, UID, Process, Refusal, World, refused
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.limits import Limits

OTHER_UID = UID + 1


def world_of(**limits: float) -> World:
    return World(Limits(**limits), access=(ALL_MAY,))  # type: ignore[arg-type]


def asked(process: Process) -> m.Peers:
    return process.request(m.GetPeers(request=0), m.Peers)


class TestCounts:
    """Two processes of one user reach each limit. A third process of that user gets nothing more."""

    @pytest.mark.parametrize(
        ("limits", "resource"),
        [
            ({"endpoints_per_peer": 2, "endpoints_per_user": 4}, "endpoints"),
            ({"topics_per_peer": 2, "topics_per_user": 4}, "topics"),
        ],
    )
    def test_endpoints_and_topics(self, limits: dict[str, int], resource: str) -> None:
        world = world_of(**limits)
        one, two, third = (world.process() for _ in range(3))
        for process in (one, two):
            for at in range(2):
                process.publisher(f"/topic_{process.id}_{at}")
            answer = refused(process.publisher, "/more")
            assert (answer.resource, answer.used, answer.limit) == (f"{resource} of a process", 2, 2)
        answer = refused(third.subscription, "/more")
        assert (answer.resource, answer.used, answer.limit) == (f"{resource} of user {UID}", 4, 4)
        assert answer.text == (
            f"{resource} of user {UID}: 4 of 4 in use; busd's limit can be raised in busd.toml"
        )
        world.process(uid=OTHER_UID).subscription("/more")
        one.die()
        third.subscription("/more")

    def test_a_topic_counts_once(self) -> None:
        process = world_of(topics_per_peer=1, topics_per_user=1).process()
        first = process.publisher("/topic")
        second = process.subscription("/topic")
        first.destroy()
        assert refused(process.publisher, "/other").resource == "topics of a process"
        second.destroy()
        process.publisher("/other")

    def test_nodes(self) -> None:
        world = world_of(nodes_per_peer=2, nodes_per_user=3)
        one, two = world.process(), world.process()
        one.node("a")
        first = one.node("b")
        two.node("c")
        answer = refused(two.node, "d")
        assert (answer.resource, answer.used, answer.limit) == (f"nodes of user {UID}", 3, 3)
        first.destroy()
        two.node("d")

    def test_matches(self) -> None:
        """A match within one process, or between two of one user, counts once for the user."""
        world = world_of(matches_per_peer=3, matches_per_user=3)
        one, two = world.process(), world.process()
        one.publisher("/topic")
        one.subscription("/topic")
        two.subscription("/topic")
        last = two.subscription("/topic")
        answer = refused(two.subscription, "/topic")
        assert (answer.resource, answer.used, answer.limit) == (f"matches of user {UID}", 4, 3)
        last.destroy()
        two.subscription("/topic")

    def test_matches_with_guests(self) -> None:
        """Matches with guests count only for the guests. Even many subscriptions of guests leave the others
        their limits.
        """
        world = world_of(matches_per_peer=3, matches_per_user=3)
        own, guest = world.process(), world.process(uid=OTHER_UID)
        for _ in range(3):
            guest.subscription("/topic")
        publishers = [own.publisher("/topic") for _ in range(2)]
        users = world.broker._quotas.users
        assert (users[UID].matches, users[OTHER_UID].matches) == (0, 6)
        answer = refused(guest.subscription, "/topic")
        assert (answer.resource, answer.used, answer.limit) == ("matches of a process", 8, 3)
        for publisher in publishers:
            publisher.destroy()
        assert users[OTHER_UID].matches == 0

    def test_bytes_of_types(self) -> None:
        world = world_of(schema_bytes=1024, control_bytes_per_peer=1024, control_bytes_per_user=2048)
        processes = [world.process() for _ in range(3)]
        for process in processes:
            for at in range(2):
                schema = b"\xc5\x03\xfd" + bytes(1021)
                process.tell(
                    m.DeclareType(type_name=f"a/msg/T{process.id}_{at}", type_hash="1", schema=schema)
                )
        assert [len(world.broker._peers[process.id].types) for process in processes] == [1, 1, 0]
        (user,) = world.broker._quotas.users.values()
        assert user.schema_bytes == 2048
        for process in processes:
            process.die()
        assert user.schema_bytes == 0

    def test_a_type_costs_what_is_kept_of_it(self) -> None:
        """busd keeps the first schema while any process has the type. A process that names a shorter one
        holds the first one, too.
        """
        world = world_of()
        long, short = world.process(), world.process()
        long.tell(m.DeclareType(type_name="a", type_hash="1", schema=b"\xc4\xff" + bytes(255)))
        short.tell(m.DeclareType(type_name="a", type_hash="1"))
        assert world.broker._peers[short.id].schema_bytes == 257


class TestDescriptors:
    def test_of_a_process(self) -> None:
        """Descriptors for its connection, its doorbell, its readers' segment, and a ring for each
        publisher.
        """
        world = world_of(descriptors_per_peer=5)
        process = world.process(shares=True)
        first = process.publisher("/a")
        process.publisher("/b")
        (record,) = asked(process).peers
        assert record.descriptors == 5
        answer = refused(process.publisher, "/c")
        assert (answer.resource, answer.used, answer.limit) == ("descriptors of a process", 5, 5)
        process.subscription("/c")
        first.destroy()
        process.publisher("/c")

    def test_of_a_user(self) -> None:
        world = world_of(descriptors_per_peer=4, descriptors_per_user=7)
        one, two = world.process(shares=True), world.process(shares=True)
        one.publisher("/a")
        assert refused(two.publisher, "/a").resource == f"descriptors of user {UID}"
        world.process(shares=True, uid=OTHER_UID).publisher("/a")
        one.die()
        two.publisher("/a")

    def test_one_that_waits_to_be_sent_counts(self) -> None:
        """A publisher that has gone leaves its ring behind, while a process that does not read still has to
        get it.
        """
        world = world_of(descriptors_per_peer=5)
        talker, sleeper = world.process(shares=True), world.process(shares=True)
        sleeper.subscription("/topic")
        sleeper.is_blocked = True
        for _ in range(2):
            talker.publisher("/topic").destroy()
        assert refused(talker.publisher, "/topic").resource == "descriptors of a process"
        sleeper.is_blocked = False
        world.carry_out([])
        sleeper.carried.clear()
        gc.collect()
        talker.publisher("/topic")

    def test_no_room_for_what_is_shared(self) -> None:
        """No answer to Share could refuse it. All matches go by socket, and the log has the reason."""
        world = world_of(descriptors_per_peer=3, descriptors_per_user=5)
        world.process(shares=True)
        late = world.process("late", shares=True)
        assert late.cut_reason is None
        assert world.notes == [
            f"limit reached by late (pid 101) of user {UID}: descriptors of user {UID}: 4 of 5"
        ]
        late.publisher("/topic", ring=False)

    def test_no_room_for_a_longer_ring(self) -> None:
        world = world_of(descriptors_per_peer=4)
        talker, listener = world.process(shares=True), world.process(shares=True)
        subscription = listener.subscription("/topic")
        listener.is_blocked = True
        publisher = talker.publisher("/topic")  # this ring waits in busd
        talker.tell(m.ReplaceRing(publisher=publisher.id), "longer")
        listener.unblock()
        world.carry_out([])
        assert [one.route for one in subscription.got(m.Rerouted)] == ["socket"]
        assert any("its new ring was lost" in note for note in world.notes)


class TestRate:
    def flood(self, process: Process, number: int) -> list[m.Created | m.Refused]:
        before = len(process.sent)
        process.send_bytes(m.encode_frame(m.CreateNode(1, "n")) * number)
        return [one for one in process.sent[before:] if isinstance(one, m.Created | m.Refused)]

    def world(self, **limits: float) -> World:
        few = {"nodes_per_peer": 10, "endpoints_per_peer": 5, "matches_per_peer": 31}
        return world_of(**{"declarations_per_s_per_peer": 10, **few, **limits})

    def test_all_that_it_may_have_comes_at_once(self) -> None:
        """Nodes, endpoints with their types, and one thing more from time to time: 10 + 10 + 4 * 5."""
        world = self.world(nodes_per_user=1000)
        process = world.process()
        for _ in range(2):
            node = process.node("node")
            for _ in range(19):
                process.tell(m.DeclareType(type_name="a", type_hash="b"))
        answer = refused(process.node)
        assert (answer.resource, answer.used, answer.limit) == (
            "declarations per second of a process",
            10,
            10,
        )
        world.advance(0.1)
        process.node()
        node.destroy()

    def test_who_asks_too_much_is_not_listened_to_for_a_while(self) -> None:
        world = self.world()
        process = world.process()
        self.flood(process, 1000)
        assert world.pauses == [(process.id, SECOND)]
        world.advance(1.1)
        self.flood(process, 100)
        assert len(world.pauses) == 2

    def test_who_acknowledges_too_much_is_made_to_wait(self) -> None:
        """busd also counts all other control frames, with a limit ten times as high. It refuses none of
        them.
        """
        world = self.world()
        talker, listener = world.process(), world.process()
        keep_all = QoSProfile(history="keep_all")
        publisher = talker.publisher("/t", keep_all)
        subscription = listener.subscription("/t", keep_all)
        publisher.publish("x")
        for _ in range(100 + 31):
            subscription.ack(publisher, 1)
        assert world.pauses == []
        for _ in range(50):
            subscription.ack(publisher, 1)
        assert world.pauses[-1] == (listener.id, SECOND // 2)
        world.advance(0.6)
        world.pauses.clear()
        subscription.ack(publisher, 1)
        assert world.pauses == []

    def test_a_short_pause_is_no_shelter(self) -> None:
        """A question in the same read costs a short pause. The process gets the pause of a second all the
        same.
        """
        world = self.world()
        process = world.process()
        for number in range(1, 7):
            process.tell(m.GetGraph(request=number))
        self.flood(process, 1000)
        assert world.pauses == [(process.id, SECOND // 10), (process.id, SECOND)]

    def test_a_pause_is_no_silence(self) -> None:
        world = self.world(lease_s=0.4)
        process = world.process()
        self.flood(process, 1000)
        assert world.pauses == [(process.id, SECOND // 10)]

    def test_of_a_user(self) -> None:
        world = self.world(declarations_per_s_per_user=10, endpoints_per_user=5, matches_per_user=31,
                           nodes_per_user=10)  # fmt: skip
        one, two, other = world.process(), world.process(), world.process(uid=OTHER_UID)
        self.flood(one, 1000)
        answer = refused(two.node)
        assert (answer.resource, answer.limit) == (f"declarations per second of user {UID}", 10)
        other.node()
        for _ in range(5):
            two.tell(m.Ping())
        assert {peer for peer, _ in world.pauses} == {one.id}, "who is not to blame is listened to"

    def test_coming_back_does_not_help(self) -> None:
        world = self.world(declarations_per_s_per_user=10, endpoints_per_user=5, matches_per_user=31,
                           nodes_per_user=10)  # fmt: skip
        first = world.process()
        self.flood(first, 1000)
        first.die()
        world.process(uid=OTHER_UID)  # at this moment, busd forgets users that have left
        assert refused(world.process().node).resource == f"declarations per second of user {UID}"
        world.advance(60)
        world.process().node()

    def test_commands(self) -> None:
        """Reload, stop and restart: ten at once, then one a second, for all processes of a user."""
        world = self.world()
        one, two = world.process(), world.process()
        for number in range(1, 8):
            one.tell(m.Reload(request=number))
            two.tell(m.StopBroker(request=number, restart=True))
        refusals = one.got(m.Refused) + two.got(m.Refused)
        assert [answer.request for answer in refusals] == [6, 7, 6, 7]
        assert refusals[0].again
        assert not refusals[0].resource
        assert refusals[0].text.startswith("too many requests to reload, stop or restart: busd accepts 10 ")
        two.die()
        world.advance(2.5)
        back = world.process()
        for number in range(1, 5):
            back.tell(m.Reload(request=number))
        assert [answer.request for answer in back.got(m.Refused)] == [3, 4]
        assert asked(back).users[0].refused == 6

    def test_what_has_no_answer_is_carried_out(self) -> None:
        world = self.world()
        process = world.process()
        node = process.node()
        self.flood(process, 1000)
        process.tell(m.DeclareType(type_name="a", type_hash="b"))
        node.destroy()
        assert node.id not in world.broker.graph.nodes
        assert ("a", "b") in world.broker.graph.types.trusted
        assert process.cut_reason is None

    def test_pings_are_questions_that_are_always_answered(self) -> None:
        world = self.world()
        process = world.process()
        for number in range(1, 101):
            process.tell(m.Ping(number=number))
        assert len(process.got(m.Pong)) == 100
        assert world.pauses == [(process.id, SECOND)]
        refused(process.node)

    def test_questions_count_by_their_answers(self) -> None:
        world = self.world(nodes_per_peer=1000, nodes_per_user=1000)
        busy, curious = world.process(), world.process()
        for _ in range(320):
            busy.node()
        asked = 0
        while True:
            try:
                curious.request(m.GetGraph(request=0), m.GraphSnapshot)
            except Refusal:
                break
            asked += 1
        assert asked == (10 + 1000 + 4 * 5) // 11

    def test_who_only_asks_is_made_to_wait(self) -> None:
        """The pause comes long before a refusal: questions that cost half a second may come at once."""
        world = self.world()
        process = world.process()
        for number in range(1, 6):
            process.tell(m.GetGraph(request=number))
        assert not world.pauses
        process.tell(m.GetGraph(request=6))
        assert world.pauses == [(process.id, SECOND // 10)]
        process.node()
        world.advance(0.1)
        process.tell(m.GetPeers(request=7))
        assert world.pauses[1:] == [(process.id, SECOND // 10)]
        assert len(process.got(m.GraphSnapshot)) == 6 and len(process.got(m.Peers)) == 1

    def test_matches_are_part_of_an_answer(self) -> None:
        world = self.world(endpoints_per_peer=100, endpoints_per_user=200, matches_per_peer=3200)
        busy, curious = world.process(), world.process()
        for _ in range(50):
            busy.publisher("/topic"), busy.subscription("/topic")
        before = len(curious.sent)
        for number in range(1, 100):
            curious.tell(m.GetGraph(request=number))
        answers = [one for one in curious.sent[before:] if isinstance(one, m.GraphSnapshot)]
        assert len(answers) == (10 + 10 + 3200 // 32 + 4 * 100) // (1 + (1 + 100 + 2500) // 32)

    def test_a_guest_s_question_for_a_type_costs_a_look_at_the_graph(self) -> None:
        world = self.world(nodes_per_peer=1000, nodes_per_user=1000)
        busy, curious, guest = world.process(), world.process(), world.process(uid=OTHER_UID)
        busy.publisher("/topic")
        for _ in range(319):
            busy.node()
        for process, cost in ((curious, 1), (guest, 11)):
            for number in range(1, 2000):
                process.tell(m.GetType(request=number, type_name=TEXT[0], type_hash=TEXT[1]))
            assert len(process.got(m.TypeDescription)) == (10 + 1000 + 4 * 5) // cost

    def test_samples_and_signs_of_life_do_not_count(self) -> None:
        world = self.world()
        process = world.process()
        publisher = process.publisher("/topic")
        for _ in range(1000):
            process.tell(m.AssertLiveliness(publisher=publisher.id))
            publisher.publish("x")
        process.node()
        assert not world.pauses


class TestLog:
    def test_once_for_each_limit_until_it_was_not_reached_for_a_while(self) -> None:
        world = world_of(nodes_per_peer=1, endpoints_per_peer=1, lease_s=3600)
        process = world.process("greedy")
        process.node()
        for _ in range(5):
            refused(process.node)
            world.advance(3)
        text = f"limit reached by greedy (pid 100) of user {UID}: nodes of a process: 1 of 1"
        assert world.notes == [text]
        world.advance(10)
        refused(process.node)
        assert world.notes == [text] * 2

    def test_each_process_and_each_limit_by_itself(self) -> None:
        world = world_of(nodes_per_peer=1, endpoints_per_peer=1)
        for process in (world.process(), world.process()):
            node = process.node(f"node_{process.id}")
            refused(process.node)
            node.publisher("/topic")
            refused(node.publisher, "/topic")
        assert len(world.notes) == 4


def test_a_busy_robot_meets_no_limit() -> None:
    """Twenty processes of one user declare 2,000 endpoints on 1,000 topics, all at once, and again."""
    world = World()
    for _ in range(2):
        processes = [world.process(f"process {at}", shares=True) for at in range(20)]
        for at, process in enumerate(processes):
            node = process.node(f"node_{at}")
            for number in range(50):
                node.publisher(f"/topic_{50 * at + number}")
                node.subscription(f"/topic_{50 * (at + 1) % 1000 + number}")
        tool = world.process("tool")
        for _ in range(4):
            tool.request(m.GetGraph(request=0), m.GraphSnapshot)
        answer = asked(tool)
        assert (answer.users[0].endpoints, answer.users[0].topics) == (2000, 1000)
        assert not any(user.refused for user in answer.users)
        assert not world.pauses
        assert not world.notes
        for process in (*processes, tool):
            process.die()
