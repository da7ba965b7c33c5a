"""busd.core.registry: permitted declarations, and the rules and limits for them."""

import msgspec
import pytest

from broker_world import ALL_MAY, NUMBER, TEXT, UID, Process, World, refused
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import NAMESAKES
from busd.core.access import Access
from busd.core.limits import Limits, TopicRule
from rows import for_each

ONE_KIB = 1024


def told(process: Process) -> list[m.Namesake]:
    """The messages about nodes with the same name as one of its own."""
    return [message for message in process.messages if isinstance(message, m.Namesake)]


class TestNames:
    @for_each(
        ("name", "namespace", "text"),
        [
            ("", "/", "node name must not be empty"),
            ("1node", "/", "must not start with a number"),
            ("a/b", "/", "must not contain characters other than alphanumerics or '_'"),
            ("a" * 256, "/", "255"),
            ("a", "ns", "namespace"),
            ("a", "/ns/", "namespace"),
            ("a", "", "namespace"),
        ],
    )
    def test_of_nodes(self, name: str, namespace: str, text: str) -> None:
        process = World().process()
        assert text in refused(process.node, name, namespace).text
        assert process.cut_reason is None
        process.node("after_that")

    @for_each("topic", ["", "relative", "/", "/a/", "/a//b", "/1a", "~/a", "/{node}", "/ä", "/" + 247 * "a"])
    @for_each("kind", ["publisher", "subscription"])
    def test_of_topics(self, topic: str, kind: str) -> None:
        world = World()
        process = world.process()
        answer = refused(getattr(process, kind), topic)
        assert "topic name" in answer.text
        assert answer.resource == ""
        assert process.cut_reason is None
        assert not world.broker.graph.topics

    def test_two_nodes_of_one_name_are_allowed_and_noted(self) -> None:
        world = World()
        world.process().node("twin", "/a")
        world.process().node("twin")
        assert not world.notes
        world.process().node("twin", "/a")
        assert world.notes == [
            "there is more than one node named /a/twin: program (pid 100) and program (pid 102)"
        ]

    def test_both_processes_are_told_once_of_two_nodes_of_one_name(self) -> None:
        world = World()
        first, second, third = (world.process(name, capabilities=(NAMESAKES,)) for name in ("a", "b", "c"))
        old = world.process("old")
        nodes = [process.node("twin") for process in (first, second, third, old)]
        assert told(first) == [m.Namesake(node=nodes[0].id, pid=101, program="b")]
        assert told(second) == [m.Namesake(node=nodes[1].id, pid=100, program="a")]
        assert told(third) == [m.Namesake(node=nodes[2].id, pid=100, program="a")]
        assert told(old) == []
        two = [third.node("alone").id for _ in range(2)]
        assert sorted(message.node for message in told(third)[1:]) == two
        assert told(third)[1].pid == 102

    def test_in_another_pid_namespace(self) -> None:
        """All pids are 0 there. A second connection of the same process may be the same program that comes
        back.
        """
        world = World()
        first, again, other = (
            world.process(name, capabilities=(NAMESAKES,), key=key)
            for name, key in (("a", "one"), ("a", "one"), ("b", "two"))
        )
        nodes = [process.node("twin") for process in (first, again)]
        assert told(first) == told(again) == []
        other.node("twin")
        assert told(first) == [m.Namesake(node=nodes[0].id, pid=0, program="b")]
        assert [message.program for message in told(other)] == ["a"]

    def test_a_name_is_free_when_its_node_has_gone(self) -> None:
        world = World()
        first, second = (world.process(capabilities=(NAMESAKES,)) for _ in range(2))
        first.tell(m.DestroyNode(node=first.node("twin").id))
        second.node("twin")
        assert told(first) == told(second) == []

    def test_a_guest_is_not_told_of_the_nodes_of_others(self) -> None:
        world = World(access=(ALL_MAY,))
        owner = world.process("owner", capabilities=(NAMESAKES,))
        guest = world.process("guest", uid=12345, capabilities=(NAMESAKES,))
        owner.node("twin")
        guest.node("twin")
        assert [message.program for message in told(owner)] == ["guest"]
        assert told(guest) == []


class TestQuotas:
    def test_nodes(self) -> None:
        world = World(Limits(nodes_per_peer=2))
        greedy, modest = world.process(), world.process()
        greedy.node("a")
        greedy.node("b")
        answer = refused(greedy.node, "c")
        assert (answer.resource, answer.used, answer.limit) == ("nodes of a process", 2, 2)
        assert answer.text == "nodes of a process: 2 of 2 in use; busd's limit can be raised in busd.toml"
        modest.node("c")

    def test_what_was_destroyed_does_not_count(self) -> None:
        process = World(Limits(nodes_per_peer=1, endpoints_per_peer=1)).process()
        for _ in range(5):
            node = process.node()
            node.publisher("/topic").destroy()
            node.subscription("/topic")
            node.destroy()

    def test_endpoints(self) -> None:
        world = World(Limits(endpoints_per_peer=3))
        greedy, modest = world.process(), world.process()
        for at in range(3):
            greedy.publisher(f"/topic_{at}")
        for make in (greedy.publisher, greedy.subscription):
            answer = refused(make, "/more")
            assert (answer.resource, answer.used, answer.limit) == ("endpoints of a process", 3, 3)
        assert "/more" not in world.broker.graph.topics
        modest.subscription("/topic_0")

    def test_topics(self) -> None:
        world = World(Limits(topics=2))
        process = world.process()
        process.publisher("/a")
        second = process.publisher("/b")
        answer = refused(world.process().publisher, "/c")
        assert (answer.resource, answer.used, answer.limit) == ("topics", 2, 2)
        world.process().subscription("/a")
        second.destroy()
        world.process().publisher("/c")

    def test_ten_thousand_endpoints(self) -> None:
        world = World()
        flood = world.process()
        node = flood.node()
        flood.declare_type(TEXT)
        message = m.CreatePublisher(
            request=1,
            node=node.id,
            topic="/flood",
            type_name=TEXT[0],
            type_hash=TEXT[1],
            qos=QoSProfile(),
            gid=bytes(16),
        )
        before = len(flood.messages)
        flood.send_bytes(m.encode_frame(message) * 10_000)
        most = world.broker.settings.limits.endpoints_per_peer
        answers = flood.messages[before:]
        assert sum(isinstance(one, m.Created) for one in answers) == most
        assert sum(isinstance(one, m.Refused) for one in answers) == 10_000 - most
        assert flood.cut_reason is None

    def test_the_depth(self) -> None:
        process = World(Limits(depth=100)).process()
        process.publisher("/topic", QoSProfile(depth=100))
        for make in (process.publisher, process.subscription):
            answer = refused(make, "/topic", QoSProfile(depth=101))
            assert answer.text == "depth 101 is more than busd's limit of 100"
        process.subscription("/topic", QoSProfile(101, history="keep_all"))

    @for_each("topic", ["/rosout", "/parameter_events", "/node/get_parameters/_reply"])
    def test_the_depth_of_what_every_node_has(self, topic: str) -> None:
        process = World(Limits(depth=100)).process()
        assert process.publisher(topic, QoSProfile(depth=1000)).created.depth == 100


class TestTypes:
    def test_too_many_for_their_endpoints(self) -> None:
        """A program that uses one type more than its limit of endpoints gets a refusal; busd does not cut it
        off.
        """
        process = World(Limits(endpoints_per_peer=2)).process()
        process.publisher("/a", kind=("a", "1"))
        process.publisher("/b", kind=("b", "1"))
        answer = refused(process.publisher, "/c", kind=("c", "1"))
        assert answer.resource == "endpoints of a process"
        assert process.cut_reason is None

    def test_too_many(self) -> None:
        process = World(Limits(endpoints_per_peer=2)).process()
        process.publisher("/a", kind=("a", "1")).destroy()
        process.publisher("/b", kind=("b", "1")).destroy()
        answer = refused(process.publisher, "/c", kind=("c", "1"))
        assert (answer.resource, answer.used, answer.limit) == ("types of a process", 2, 2)
        process.publisher("/b", kind=("b", "1"))

    def test_said_again_a_type_needs_no_more_room(self) -> None:
        world = World(Limits(endpoints_per_peer=1))
        process = world.process()
        for _ in range(3):
            process.tell(m.DeclareType(type_name="a", type_hash="1"))
        assert not world.notes

    def test_a_schema_that_is_too_long(self) -> None:
        process = World(Limits(schema_bytes=ONE_KIB)).process()
        process.tell(m.DeclareType(type_name="a", type_hash="1", schema=(b"\xd9\xff" + b"x" * 255)))
        assert process.cut_reason is None
        long = msgspec.msgpack.encode("x" * ONE_KIB)
        process.declare_type(("b", "1"), long)
        for make in (process.publisher, process.subscription):
            answer = refused(make, "/t", kind=("b", "1"))
            text = "the schema of b has 1027 bytes, the limit is 1024; in busd.toml it is schema_bytes"
            assert answer.text.startswith(text)
            assert (answer.resource, answer.again) == ("", False)
        process.publisher("/t", kind=("a", "1"))
        assert process.cut_reason is None

    def test_schemas_that_are_too_long_count_as_types(self) -> None:
        process = World(Limits(schema_bytes=ONE_KIB, endpoints_per_peer=2)).process()
        for name in "abcdef":
            process.declare_type((name, "1"), bytes(ONE_KIB + 1))
        assert refused(process.publisher, "/t", kind=("b", "1")).text.startswith("the schema of b has 1025 ")
        answer = refused(process.publisher, "/t", kind=("f", "1"))
        assert (answer.resource, answer.used, answer.limit) == ("types of a process", 2, 2)

    def test_a_schema_that_a_larger_limit_lets_in(self) -> None:
        world = World(Limits(schema_bytes=ONE_KIB, endpoints_per_peer=1))
        process, kind = world.process(), ("a", "1")
        process.declare_type(kind, bytes(ONE_KIB + 1))
        limits = Limits(schema_bytes=2 * ONE_KIB, endpoints_per_peer=1)
        world.broker.reconfigure(world.now_ns, limits, (), Access(UID))
        text = refused(process.publisher, "/t", kind=kind).text
        assert text.startswith("the schema of a has 1025 bytes, the limit is 1024; ")
        process.declare_type(kind, bytes(ONE_KIB + 1))
        process.publisher("/t", kind=kind)

    @for_each("text", ["a\nb", "\x1b[2J", "a\u202eb", "a\x00"])
    @for_each("field", ["type_name", "type_hash"])
    def test_what_would_play_tricks_on_a_terminal_is_no_name(self, field: str, text: str) -> None:
        process = World().process()
        process.tell(m.DeclareType(**{"type_name": "a", "type_hash": "1", field: text}))  # type: ignore[arg-type]
        assert process.cut_reason == f"type name or hash {text!r}, which can't be printed"

    def test_the_first_schema_of_a_type_stays(self) -> None:
        world = World()
        one, other = world.process(), world.process()
        for process, schema in ((one, "first"), (other, "second")):
            raw = msgspec.msgpack.encode(schema)
            process.tell(m.DeclareType(type_name="a", type_hash="1", schema=raw))
        answer = other.request(m.GetType(request=0, type_name="a", type_hash="1"), m.TypeDescription)
        assert msgspec.msgpack.decode(answer.schema) == "first"


class TestRules:
    RULES = (
        TopicRule(pattern="/camera/**", max_depth=3, max_lifespan_s=1.0),
        TopicRule(pattern="/camera/raw", max_message_bytes=2 * ONE_KIB),
    )

    def process(self) -> Process:
        return World(rules=self.RULES).process()

    @pytest.mark.parametrize("kind", ["publisher", "subscription"])
    def test_the_answer_says_what_holds(self, kind: str) -> None:
        made = getattr(self.process(), kind)("/camera/raw", QoSProfile(depth=50)).created
        assert (made.depth, made.max_message_bytes) == (3, 2 * ONE_KIB)

    def test_other_topics_keep_the_limits(self) -> None:
        world = World(rules=self.RULES)
        limits = world.broker.settings.limits
        made = world.process().publisher("/other", QoSProfile(depth=50)).created
        assert made == m.Created(
            request=made.request,
            id=made.id,
            depth=50,
            max_message_bytes=limits.message_bytes,
            window_samples=limits.keep_all_window_messages,
            window_bytes=limits.keep_all_window_bytes,
            ring_bytes=limits.ring_bytes,
        )

    def test_keep_all_has_no_depth(self) -> None:
        made = self.process().publisher("/camera/raw", QoSProfile(history="keep_all")).created
        assert made.depth == 0

    def test_a_smaller_depth_stays(self) -> None:
        assert self.process().subscription("/camera/raw", QoSProfile(depth=2)).created.depth == 2

    @pytest.mark.parametrize("kind", ["publisher", "subscription"])
    def test_a_depth_above_the_limit_that_a_rule_caps(self, kind: str) -> None:
        process = World(Limits(depth=100), self.RULES).process()
        assert getattr(process, kind)("/camera/raw", QoSProfile(depth=1000)).created.depth == 3

    def test_the_match_and_the_graph_say_it_too(self) -> None:
        process = self.process()
        process.publisher("/camera/raw", QoSProfile(depth=50))
        subscription = process.subscription("/camera/raw")
        (matched,) = subscription.got(m.Matched)
        assert (matched.qos.depth, matched.qos.lifespan) == (3, 1.0)
        assert {record.qos.depth for record in process.graph().endpoints} == {3}

    def test_it_is_carried_out(self) -> None:
        world = World(rules=self.RULES)
        listener = world.process()
        subscription = listener.subscription("/camera/raw", QoSProfile(depth=50))
        publisher = world.process().publisher("/camera/raw", QoSProfile(depth=50))
        listener.is_blocked = True
        publisher.publish_many("abcdef")
        listener.unblock()
        assert subscription.payloads == ["d", "e", "f"]


def test_ids_are_never_used_twice() -> None:
    world = World()
    seen = set()
    for _ in range(3):
        process = world.process()
        node = process.node()
        for made in (node, node.publisher("/a"), node.subscription("/a", kind=NUMBER)):
            assert made.id not in seen
            seen.add(made.id)
        process.die()
