"""busd.core.quotas: the share that a process leaves to others of its user, the accounts of shared things, the
log.
"""

import pytest

from broker_world import ALL_MAY, SECOND, UID, Process, Refusal, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.access import Access
from busd.core.limits import Limits
from rows import for_each

OTHER_UID = UID + 1
UNBOUNDED = QoSProfile(history="keep_all", reliability="best_effort")
KEPT = QoSProfile(depth=100, durability="transient_local")
FEW = {
    "nodes_per_peer": 10,
    "endpoints_per_peer": 5,
    "matches_per_peer": 31,
    "declarations_per_s_per_peer": 10,
}
SMALL = {"message_bytes": 1024, "keep_all_window_bytes": 1024}


def world_of(**limits: float) -> World:
    return World(Limits(**limits), access=(ALL_MAY,))  # type: ignore[arg-type]


def nodes_until_refused(process: Process) -> tuple[int, str]:
    """The number of nodes that the process can make now, and the resource at which that ends."""
    for number in range(100_000):
        try:
            process.node()
        except Refusal as refusal:
            return number, refusal.answer.resource
    raise AssertionError("nothing ends it")


def pings_until_it_must_wait(process: Process) -> int:
    """The number of declarations that are left. A ping counts as one."""
    for number in range(1, 100_000):
        process.tell(m.Ping())
        if process.id in dict(process.world.pauses):
            return number
    raise AssertionError("nothing ends it")


class TestOthersOfTheUser:
    def test_signs_of_life_leave_them_all_that_the_user_may_declare(self) -> None:
        world = world_of(**FEW, **{name.replace("peer", "user"): 2 * value for name, value in FEW.items()})
        chatty, other = world.process(), world.process()
        for _ in range(1000):
            chatty.tell(m.Ping())
        assert nodes_until_refused(other) == (10, "nodes of a process")

    def test_what_has_no_answer_is_done_also_where_the_user_has_declared_too_much(self) -> None:
        world = world_of(**FEW, **{name.replace("peer", "user"): value for name, value in FEW.items()})
        busy, other = world.process(), world.process()
        node = other.node()
        busy.send_bytes(m.encode_frame(m.CreateNode(1, "n")) * 1000)
        with pytest.raises(Refusal, match="declarations per second of user"):
            other.node()
        node.destroy()
        other.tell(m.DeclareType(type_name="a", type_hash="b"))
        assert other.cut_reason is None
        assert node.id not in world.broker.graph.nodes
        assert ("a", "b") in world.broker.graph.types.trusted

    def test_bytes_that_a_user_may_have_change_with_the_limits(self) -> None:
        world = world_of(history_bytes_per_peer=64_000)  # so little that busd gathers no runs
        sleepers = [world.process() for _ in range(3)]
        for sleeper in sleepers:
            sleeper.subscription("/topic", UNBOUNDED)
            sleeper.is_blocked = True
        talkers = [world.process(uid=OTHER_UID), world.process(), world.process()]
        talkers[0].publisher("/topic").publish_many(f"{at:700}" for at in range(9))
        for talker in talkers[1:]:
            talker.publisher("/other", KEPT).publish_many(f"{at:700}" for at in range(9))
        sizes = {"queued_bytes_per_peer": 10_000, "history_bytes_per_peer": 10_000}
        sizes |= {"queued_bytes_per_user": 15_000, "history_bytes_per_user": 11_000}
        new = Limits(**SMALL, **sizes)
        world.carry_out(world.broker.reconfigure(world.now_ns, new, (), Access(UID, (ALL_MAY,))))
        (user,) = (one for one in self.asked(world.process()).users if one.uid == UID)
        assert 13_000 < user.queued_bytes <= 15_000
        assert 9_000 < user.history_bytes <= 11_000

    def test_a_descriptor_counts_for_who_has_left_as_long_as_it_waits_to_be_sent(self) -> None:
        world = World(Limits(lease_s=3600), access=(ALL_MAY,))
        sleeper, talker = (world.process(uid=OTHER_UID, shares=True) for _ in range(2))
        sleeper.subscription("/topic")
        sleeper.is_blocked = True
        talker.publisher("/topic")
        talker.die()
        world.advance(60)
        back = world.process(uid=OTHER_UID)
        of_those_here = 2 * 1 + 2  # their connections, and the segments that the sleeper shares
        (user,) = self.asked(back).users
        assert user.descriptors == of_those_here + 2  # the ring and the doorbell of the process that has left
        sleeper.is_blocked = False
        sleeper.read()
        (user,) = self.asked(back).users
        assert user.descriptors == of_those_here

    @staticmethod
    def asked(process: Process) -> m.Peers:
        return process.request(m.GetPeers(request=0), m.Peers)


class TestWhatADeclarationCosts:
    def test_a_guest_pays_for_a_look_at_the_graph_where_it_takes_one(self) -> None:
        """A large graph makes questions expensive, and nothing else."""
        world = world_of(**{**FEW, "nodes_per_user": 1000, "nodes_per_peer": 1000})
        busy, guest = world.process(), world.process(uid=OTHER_UID)
        for _ in range(640):
            busy.node()
        assert nodes_until_refused(guest) == (1000, "nodes of a process")

    def test_matches_are_paid_for(self) -> None:
        """Thirty-two matches cost as much as a declaration."""
        world = world_of(**{**FEW, "endpoints_per_peer": 20, "matches_per_peer": 640})
        for _ in range(64):
            world.process(uid=OTHER_UID).subscription("/crowded")
        left = list[int]()
        for uid, topic in ((UID + 2, "/alone"), (UID + 3, "/crowded")):
            process = world.process(uid=uid)
            for _ in range(10):
                process.publisher(topic)
            left.append(pings_until_it_must_wait(process))
        assert left[0] - left[1] == 10 * 64 // 32

    def test_one_that_may_ask_once_a_second_may_ask_once(self) -> None:
        world = world_of(**{**FEW, "declarations_per_s_per_peer": 1})
        process = world.process()
        process.graph()
        assert not world.pauses
        process.graph()
        assert world.pauses == [(process.id, SECOND)]

    def test_who_asks_is_not_made_to_wait_until_its_lease_ends(self) -> None:
        world = world_of(**{**FEW, "declarations_per_s_per_peer": 1}, lease_s=0.4)
        process = world.process()
        process.graph()
        process.graph()
        assert world.pauses == [(process.id, SECOND // 10)]


class TestLog:
    @for_each("whose", ["peer", "user"])
    @for_each("what", ["queued", "history"])
    def test_bytes_are_told_once_and_of_the_one_that_loses_some(self, what: str, whose: str) -> None:
        small = {"peer": 12_000, "user": 12_000} if whose == "user" else {"peer": 8_000, "user": 100_000}
        sizes = {f"{kind}_bytes_per_{who}": small[who] for kind in ("queued", "history") for who in small}
        world = world_of(**SMALL, **sizes)
        little, much = world.process("little"), world.process("much")
        for process, topic, number in ((little, "/little", 3), (much, "/much", 20)):
            if what == "queued":
                process.subscription(topic, UNBOUNDED)
                process.is_blocked = True
                process = world.process(uid=OTHER_UID)
            publisher = process.publisher(topic, None if what == "queued" else KEPT)
            publisher.publish_many(f"{at:700}" for at in range(number))
        (note,) = world.notes
        name = "bytes queued for" if what == "queued" else "bytes of history of"
        owner = "a process" if whose == "peer" else f"user {UID}"
        assert note.startswith(f"limit reached by much (pid 101) of user {UID}: {name} {owner}: ")
        assert note.endswith(f" of {small[whose]}")


class TestHistories:
    def test_the_longest_of_a_process_loses_its_oldest(self) -> None:
        world = world_of(**SMALL, history_bytes_per_peer=10_000)
        process = world.process()
        short, long = process.publisher("/short", KEPT), process.publisher("/long", KEPT)
        short.publish_many("abc")
        long.publish_many(f"{at:700}" for at in range(20))
        late = world.process()
        assert late.subscription("/short", KEPT).payloads == [*"abc"]
        kept = [int(text) for text in late.subscription("/long", KEPT).payloads]
        assert kept == list(range(20 - len(kept), 20))
        assert 0 < len(kept) < 20


class TestQueues:
    def test_what_has_just_come_is_spared_also_where_another_queue_is_longer(self) -> None:
        world = world_of(message_bytes=8192, keep_all_window_bytes=8192, queued_bytes_per_peer=10_000)
        listener, talker = world.process(), world.process()
        long, short = (listener.subscription(one, UNBOUNDED) for one in ("/long", "/short"))
        listener.is_blocked = True
        talker.publisher("/long").publish("x" * 7000)
        talker.publisher("/short").publish("y" * 5000)
        listener.unblock()
        assert (long.payloads, short.payloads) == ([], ["y" * 5000])
        assert long.statistics(talker).dropped == {"memory_limit": 1}

    def test_a_process_without_subscriptions_has_nothing_to_lose(self) -> None:
        """The others have only one message each, which stays although it is over the limit."""
        world = world_of()
        sleeper, idle = world.process(), world.process()
        subscription = sleeper.subscription("/topic", UNBOUNDED)
        sleeper.is_blocked = True
        world.process(uid=OTHER_UID).publisher("/topic").publish("x" * 7000)
        sizes = dict.fromkeys(("queued_bytes_per_peer", "queued_bytes_per_user"), 5000)
        new = Limits(**SMALL, **sizes)
        world.carry_out(world.broker.reconfigure(world.now_ns, new, (), Access(UID, (ALL_MAY,))))
        idle.subscription("/other")
        sleeper.unblock()
        assert subscription.payloads == ["x" * 7000]


@pytest.mark.parametrize("is_later", [True, False])
def test_the_accounts_that_the_shell_charges_have_their_limits(is_later: bool) -> None:
    sizes = {"control_bytes_per_peer": 2**20, "control_bytes_per_user": 2**21, "queued_bytes_per_user": 2**27}
    limits = Limits(**sizes, queued_bytes_per_peer=2**27)
    world = World() if is_later else World(limits)
    process = world.process()
    if is_later:
        world.carry_out(world.broker.reconfigure(world.now_ns, limits, (), Access(UID)))
    control, unfinished = world.broker.entrance.accounts(process.id)
    assert control.parent is not None
    assert (control.limit, control.parent.limit, unfinished.limit) == (2**20, 2**21, 2**27)
