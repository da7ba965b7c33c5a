"""busd.core.router: samples go to queues, and every lost sample is counted with its reason."""

from broker_endpoints import Publisher
from broker_line import Line
from broker_world import SECOND, Process, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import MAX_COUNT
from busd.core.limits import Limits, TopicRule
from feeding import frame_record
from rows import for_each

KIB = 1024


class TestDelivery:
    def test_everything_in_order_with_its_number_stamp_and_source(self) -> None:
        line = Line()
        line.publisher.publish("a", "b", stamp_ns=7)
        line.publisher.publish("c", stamp_ns=9)
        source = line.publisher.id
        assert line.subscription.samples == [
            (source, 1, "a", 7, False),
            (source, 2, "b", 7, False),
            (source, 3, "c", 9, False),
        ]

    def test_every_subscription_gets_it(self) -> None:
        world = World()
        publisher = world.process().publisher("/topic")
        listeners = [world.process().subscription("/topic") for _ in range(5)]
        publisher.publish("x")
        assert [listener.payloads for listener in listeners] == [["x"]] * 5

    def test_two_publishers_each_in_its_order(self) -> None:
        world = World()
        subscription = world.process().subscription("/topic")
        one, other = world.process().publisher("/topic"), world.process().publisher("/topic")
        for at in range(3):
            one.publish(f"one {at}")
            other.publish(f"other {at}")
        for publisher in (one, other):
            assert [sample.seq for sample in subscription.samples if sample.source == publisher.id] == [
                1,
                2,
                3,
            ]

    def test_an_empty_message(self) -> None:
        line = Line()
        line.publisher.publish("")
        assert line.subscription.payloads == [""]

    def test_a_process_that_reads_loses_nothing_to_its_depth(self) -> None:
        """This is true for a run longer than the depth, too: busd sends it before it trims the queue."""
        line = Line(requested=QoSProfile(depth=1))
        line.publisher.publish(*"abcdefgh")
        line.publisher.publish(*"ijk")
        assert line.subscription.payloads == [*"abcdefghijk"]
        assert line.dropped == {}

    def test_nobody_listens(self) -> None:
        publisher = World().process().publisher("/topic")
        publisher.publish("x", "y")
        assert publisher.statistics().samples == 2


class TestDepth:
    @for_each("runs", [["abcdef"], ["abc", "def"], [*"abcdef"], ["a", "bcde", "f"]])
    @for_each("depth", [1, 2, 5, 6])
    def test_the_oldest_are_replaced(self, runs: list[str], depth: int) -> None:
        line = Line(requested=QoSProfile(depth=depth))
        line.listener.is_blocked = True
        for letters in runs:
            line.publisher.publish(*letters)
        assert line.subscription.statistics(line.talker).queued == depth
        assert line.dropped == ({"replaced": 6 - depth} if depth < 6 else {})
        line.listener.unblock()
        assert line.subscription.payloads == [*"abcdef"[6 - depth :]]
        assert [sample.seq for sample in line.subscription.samples] == list(range(7 - depth, 7))

    def test_the_most_that_a_process_missed_in_a_row(self) -> None:
        line = Line(requested=QoSProfile(depth=2))

        def stand_still(letters: str) -> int:
            line.listener.is_blocked = True
            for letter in letters:
                line.publisher.publish(letter)
            line.listener.unblock()
            return line.subscription.statistics(line.talker).most_missed

        assert stand_still("ab") == 0
        assert stand_still("abcde") == 3, "a depth of 5 would have held them"
        assert stand_still("abcd") == 3
        assert stand_still("abcdefgh") == 6
        assert line.dropped == {"replaced": 11}
        line.listener.tell(m.Report(endpoint=line.subscription.id, samples=1, bytes=1, most_missed=9))
        assert line.subscription.statistics(line.talker).most_missed == 9

    def test_keep_all_replaces_nothing(self) -> None:
        line = Line(requested=QoSProfile(depth=1, history="keep_all"))
        line.listener.is_blocked = True
        line.publisher.publish_many("abcdef")
        line.listener.unblock()
        assert line.subscription.payloads == [*"abcdef"]

    def test_a_slow_subscription_costs_its_neighbours_nothing(self) -> None:
        line = Line(requested=QoSProfile(depth=1))
        neighbour = line.world.process().subscription("/topic", QoSProfile(depth=1))
        sister = line.listener.subscription("/other", QoSProfile(depth=1))
        other = line.talker.publisher("/other")
        line.listener.is_blocked = True
        line.publisher.publish_many("abcdef")
        other.publish("x")
        line.listener.unblock()
        assert neighbour.payloads == [*"abcdef"]
        assert (line.subscription.payloads, sister.payloads) == (["f"], ["x"])
        assert neighbour.statistics().dropped == sister.statistics().dropped == {}

    def test_the_depth_is_shared_by_the_publishers(self) -> None:
        line = Line(requested=QoSProfile(depth=3))
        second = line.world.process().publisher("/topic")
        line.listener.is_blocked = True
        for _ in range(3):
            line.publisher.publish("mine")
            second.publish("other")
        line.listener.unblock()
        assert line.subscription.payloads == ["other", "mine", "other"]
        assert line.dropped == {"replaced": 3}


class TestTelling:
    def test_all_drops_of_a_while_at_once(self) -> None:
        line = Line(requested=QoSProfile(depth=1))
        line.listener.is_blocked = True
        line.publisher.publish_many("abcdef")
        line.listener.unblock()
        assert line.told() == []
        line.world.advance(0.1)
        assert line.told() == [{"replaced": 5}]
        line.world.advance(5)
        assert line.told() == [{"replaced": 5}]

    def test_totals_with_every_reason(self) -> None:
        line = Line(requested=QoSProfile(depth=1))
        line.publisher.lose(3)
        line.publisher.publish("x")
        line.world.advance(0.1)
        line.listener.is_blocked = True
        line.publisher.publish_many("ab")
        line.listener.unblock()
        line.world.advance(0.1)
        assert line.told() == [{"publisher_queue": 3}, {"publisher_queue": 3, "replaced": 1}]

    def test_a_subscription_that_has_gone_is_not_told(self) -> None:
        line = Line()
        line.publisher.lose(1)
        line.publisher.publish("x")
        line.subscription.destroy()
        line.world.advance(1)
        assert line.told() == []


class TestPublisherGaps:
    def test_what_the_publisher_replaced_itself(self) -> None:
        line = Line()
        line.publisher.publish("a")
        line.publisher.lose(4)
        line.publisher.publish("b")
        assert [sample.seq for sample in line.subscription.samples] == [1, 6]
        assert line.dropped == {"publisher_queue": 4}

    def test_only_those_count_it_that_were_matched(self) -> None:
        line = Line()
        line.publisher.lose(4)
        line.publisher.publish("b")
        late = line.world.process().subscription("/topic")
        line.publisher.publish("c")
        assert late.statistics().dropped == {}

    @for_each("first_seq", [0, 1, 2])
    def test_numbers_that_go_back_are_the_end(self, first_seq: int) -> None:
        line = Line()
        line.publisher.publish("a", "b")
        line.publisher.publish_body(1, frame_record(b"again", 0), first_seq=first_seq)
        assert line.talker.cut_reason == f"publisher {line.publisher.id} sent sample {first_seq} after 2"
        assert line.subscription.payloads == ["a", "b"]

    def test_a_publisher_may_begin_anywhere(self) -> None:
        line = Line()
        again = line.talker.publisher("/topic", next_seq=500)
        again.publish("x")
        assert line.subscription.samples[-1].seq == 500
        assert line.dropped == {}
        assert line.subscription.got(m.Matched)[-1].next_seq == 500

    def test_counters_stay_within_their_field(self) -> None:
        """The sum of three such lies would not fit into 64 bits. The subscription must learn of the losses
        all the same.
        """
        line = Line()
        for _ in range(5):
            liar = line.talker.publisher("/topic")
            liar.lose(MAX_COUNT - 1)
            liar.publish("x")
        line.world.advance(0.1)
        assert line.told() == [{"publisher_queue": MAX_COUNT}]
        line.listener.tell(
            m.Report(
                endpoint=line.subscription.id, samples=0, bytes=0, dropped={"publisher_queue": MAX_COUNT}
            )
        )
        assert line.dropped == {"publisher_queue": 2 * MAX_COUNT}


class TestTooLarge:
    LIMITS = Limits(message_bytes=64 * KIB)
    RULES = (TopicRule(pattern="/topic", max_message_bytes=KIB),)

    def test_a_message_above_the_rule(self) -> None:
        line = Line(limits=self.LIMITS, rules=self.RULES)
        line.publisher.publish("x" * KIB)
        line.publisher.publish("x" * (KIB + 1))
        line.publisher.publish("after")
        assert [len(payload) for payload in line.subscription.payloads] == [KIB, 5]
        assert line.dropped == {"too_large": 1}
        assert line.talker.cut_reason is None

    def test_a_run_above_it_of_messages_below_it(self) -> None:
        line = Line(limits=self.LIMITS, rules=self.RULES)
        line.publisher.publish(*["x" * 100] * 50)
        assert len(line.subscription.payloads) == 50

    def test_the_largest_message_of_all(self) -> None:
        line = Line(limits=self.LIMITS)
        line.publisher.publish("y", "x" * 64 * KIB)
        assert [len(payload) for payload in line.subscription.payloads] == [1, 64 * KIB]

    def test_it_is_not_kept_for_late_joiners(self) -> None:
        kept = QoSProfile(durability="transient_local")
        line = Line(offered=kept, limits=self.LIMITS, rules=self.RULES)
        line.publisher.publish("x" * 2 * KIB)
        line.publisher.publish("good")
        assert line.world.process().subscription("/topic", kept).payloads == ["good"]


class TestMemory:
    LIMITS = Limits(
        queued_bytes_per_peer=10 * KIB,
        message_bytes=2 * KIB,
        keep_all_window_bytes=KIB,
        control_bytes_per_peer=2**20,
    )

    def used(self, process: Process) -> int:
        return process.world.broker._peers[process.id].queued.used

    def test_a_process_that_never_reads(self) -> None:
        line = Line(requested=QoSProfile(history="keep_all"), limits=self.LIMITS)
        line.listener.is_blocked = True
        for at in range(100):
            line.publisher.publish(f"{at:1000}")
            assert self.used(line.listener) <= self.LIMITS.queued_bytes_per_peer
        assert line.dropped == {"memory_limit": 92}
        line.listener.unblock()
        assert [int(payload) for payload in line.subscription.payloads] == list(range(92, 100))

    def test_the_limit_is_for_all_its_subscriptions(self) -> None:
        line = Line(requested=QoSProfile(history="keep_all"), limits=self.LIMITS)
        more = [line.listener.subscription("/topic", QoSProfile(history="keep_all")) for _ in range(4)]
        line.listener.is_blocked = True
        for _ in range(50):
            line.publisher.publish("x" * 1000)
            assert self.used(line.listener) <= self.LIMITS.queued_bytes_per_peer
        for subscription in (line.subscription, *more):
            counted = subscription.statistics(line.talker)
            assert counted.queued + counted.dropped["memory_limit"] == 50

    def test_the_longest_queue_pays(self) -> None:
        """The queue that received a sample last does not lose for it: a flood costs the process's other
        topics nothing.
        """
        line = Line(requested=QoSProfile(history="keep_all"), limits=self.LIMITS)
        quiet = line.listener.subscription("/quiet")
        whisper = line.talker.publisher("/quiet")
        line.listener.is_blocked = True
        for letter in "abcde":
            line.publisher.publish_many(["x" * 1000] * 20)
            whisper.publish(letter)
            assert self.used(line.listener) <= self.LIMITS.queued_bytes_per_peer
        line.listener.unblock()
        assert quiet.payloads == [*"abcde"]
        assert quiet.statistics().dropped == {}
        assert set(line.dropped) == {"memory_limit"}

    def test_the_newest_of_each_queue_goes_last(self) -> None:
        line = Line(requested=QoSProfile(history="keep_all"), limits=self.LIMITS)
        large = line.listener.subscription("/large")
        publisher = line.talker.publisher("/large")
        line.listener.is_blocked = True
        line.publisher.publish_many(["x" * 1000] * 9)
        publisher.publish(*["y" * 2000] * 4)
        line.listener.unblock()
        assert len(line.subscription.payloads) == 1
        assert len(large.payloads) == 4

    def test_a_message_of_any_allowed_size_gets_through(self) -> None:
        limits = Limits(queued_bytes_per_peer=2 * KIB, message_bytes=2 * KIB, keep_all_window_bytes=KIB)
        line = Line(requested=QoSProfile(history="keep_all"), limits=limits)
        neighbour = line.listener.subscription("/topic")
        line.listener.is_blocked = True
        for letter in "abc":
            line.publisher.publish(letter * 2 * KIB)
        line.listener.unblock()
        assert [len(payload) for payload in (*line.subscription.payloads, *neighbour.payloads)] == [2 * KIB]
        assert {payload[0] for payload in (*line.subscription.payloads, *neighbour.payloads)} == {"c"}

    def test_depth_counts_first(self) -> None:
        line = Line(requested=QoSProfile(depth=2), limits=self.LIMITS)
        line.listener.is_blocked = True
        for _ in range(50):
            line.publisher.publish("x" * 1000)
        assert line.dropped == {"replaced": 48}


class TestExpiry:
    LASTING_A_SECOND = QoSProfile(depth=10, lifespan=1.0)

    def test_what_waited_too_long(self) -> None:
        line = Line(offered=self.LASTING_A_SECOND)
        line.listener.is_blocked = True
        line.publisher.publish("old")
        line.world.advance(0.6)
        line.publisher.publish("young")
        line.world.advance(0.6)
        line.listener.unblock()
        assert line.subscription.payloads == ["young"]
        assert line.dropped == {"expired": 1}

    def test_at_its_last_moment_it_is_delivered(self) -> None:
        line = Line(offered=self.LASTING_A_SECOND)
        line.listener.is_blocked = True
        line.publisher.publish("old")
        line.world.advance(1.0)
        line.listener.unblock()
        assert line.subscription.payloads == ["old"]

    def test_expired_is_not_replaced(self) -> None:
        """If a full queue drops expired samples, they count as expired."""
        line = Line(offered=self.LASTING_A_SECOND, requested=QoSProfile(depth=2))
        line.listener.is_blocked = True
        line.publisher.publish("a", "b")
        line.world.advance(2.0)
        line.publisher.publish("c")
        assert line.dropped == {"expired": 2}

    def test_only_those_with_a_lifespan_are_looked_at(self) -> None:
        line = Line(offered=self.LASTING_A_SECOND)
        for _ in range(3):
            line.listener.subscription("/other")
        perishable = line.world.broker._peers[line.listener.id].perishable
        assert [one.id for one in perishable] == [line.subscription.id]
        line.subscription.destroy()
        assert not perishable

    def test_without_a_lifespan_nothing_expires(self) -> None:
        line = Line()
        line.listener.is_blocked = True
        line.publisher.publish("a", stamp_ns=0)
        line.world.now_ns += 5 * SECOND
        line.listener.unblock()
        assert line.subscription.payloads == ["a"]


class TestMalformedRuns:
    def test_more_samples_than_could_stand_in_the_body(self) -> None:
        line = Line()
        line.publisher.publish_body(4_000_000_000, frame_record(b"x", 0))
        assert line.talker.cut_reason == "data frame claims 4000000000 samples in 13 bytes"

    @for_each("depth", [1, 2, 3, 4, 5])
    def test_a_listener_survives_a_liar(self, depth: int) -> None:
        """Two good samples, then a record that claims 4 GB. The account has each of them."""
        line = Line(requested=QoSProfile(depth=depth))
        line.listener.is_blocked = True
        body = frame_record(b"a", 0) + frame_record(b"b", 0) + b"\xff" * 40
        line.publisher.publish_body(5, body)
        line.listener.unblock()
        subscription = line.subscription
        assert subscription.payloads == [*"ab"][max(0, 5 - depth) :]
        assert subscription.undecodable + len(subscription.payloads) + line.dropped.get("replaced", 0) == 5

    def test_a_late_joiner_survives_a_liar(self) -> None:
        kept = QoSProfile(depth=3, durability="transient_local")
        line = Line(offered=kept)
        line.publisher.publish_body(3, frame_record(b"a", 0) + b"\xff" * 40)
        line.publisher.publish("good", "better")
        late = line.world.process().subscription("/topic", kept)
        assert late.payloads == ["good", "better"]
        assert late.undecodable == 1


@for_each("number", [0, 2, 999])
def test_samples_from_a_publisher_of_another(number: int) -> None:
    line = Line()
    offender = line.world.process()
    assert line.publisher.id == 2
    forged = Publisher(offender, m.Created(request=0, id=number), b"", 1)
    forged.publish("forged")
    assert offender.cut_reason == f"a sample from publisher {number}, which is not one of yours"
    assert line.subscription.payloads == []
    line.publisher.publish("true")
    assert line.subscription.payloads == ["true"]
