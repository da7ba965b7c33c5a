"""busd.core.quotas and busd.core.overload: bytes of a process and of a user, and limits that change."""

from typing import Any

import pytest

from broker_world import ALL_MAY, UID, Refusal, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.access import Access
from busd.core.limits import Limits

OTHER_UID = UID + 1


def world_of(**limits: float) -> World:
    return World(Limits(**limits), access=(ALL_MAY,))  # type: ignore[arg-type]


TIGHT = {
    "message_bytes": 1024,
    "keep_all_window_bytes": 1024,
    "queued_bytes_per_peer": 10_000,
    "queued_bytes_per_user": 12_000,
    "history_bytes_per_peer": 10_000,
    "history_bytes_per_user": 12_000,
}


class TestBytes:
    def sleeper(self, world: World, topic: str, *, uid: int = UID) -> Any:
        process = world.process(f"sleeper {topic[1:]}", uid=uid)
        subscription = process.subscription(topic, QoSProfile(history="keep_all", reliability="best_effort"))
        process.is_blocked = True
        return subscription

    def test_the_process_with_most_loses_its_oldest(self) -> None:
        world = world_of(**TIGHT)
        much, little = self.sleeper(world, "/much"), self.sleeper(world, "/little")
        stranger = self.sleeper(world, "/much", uid=OTHER_UID)
        talker = world.process()
        publishers = {name: talker.publisher(f"/{name}") for name in ("much", "little")}
        publishers["much"].publish_many(f"{at:700}" for at in range(9))  # 1 KB each, with the cost of a run
        publishers["little"].publish_many(f"{at:700}" for at in range(5))
        user = world.broker._quotas.users[UID]
        assert user.queued.used <= 12_000
        for subscription in (much, little, stranger):
            subscription.process.unblock()
        world.carry_out([])
        assert [int(text) for text in little.payloads] == [0, 1, 2, 3, 4]
        assert [int(text) for text in stranger.payloads] == list(range(9))
        lost = 9 - len(much.payloads)
        assert [int(text) for text in much.payloads] == list(range(lost, 9))
        assert lost > 0
        assert much.statistics(talker).dropped == {"memory_limit": lost}
        assert user.queued.used == 0
        (note,) = world.notes
        assert note.startswith(
            f"limit reached by sleeper much (pid 100) of user {UID}: bytes queued for user {UID}: "
        )

    def test_the_newest_gets_through_whatever_others_hold(self) -> None:
        world = world_of(**TIGHT)
        sleepers = [self.sleeper(world, f"/{name}") for name in "abc"]
        talker = world.process()
        for name, size in (("a", 700), ("b", 700), ("c", 700)):
            publisher = talker.publisher(f"/{name}")
            publisher.publish_many(f"{at:{size}}" for at in range(30))
        for subscription in sleepers:
            subscription.process.unblock()
        world.carry_out([])
        for subscription in sleepers:
            assert int(subscription.payloads[-1]) == 29
            assert len(subscription.payloads) + subscription.statistics(talker).dropped["memory_limit"] == 30

    def test_what_went_is_free_again(self) -> None:
        world = world_of(**TIGHT)
        sleepers = [self.sleeper(world, f"/{name}") for name in "ab"]
        talker = world.process()
        for name in "ab":
            talker.publisher(f"/{name}").publish_many(f"{at:700}" for at in range(30))
        user = world.broker._quotas.users[UID]
        sleepers[0].process.die()
        sleepers[1].destroy()
        assert user.queued.used == 0

    def test_history(self) -> None:
        world = world_of(**TIGHT)
        kept = QoSProfile(depth=100, durability="transient_local")
        one, two, stranger = world.process(), world.process(), world.process(uid=OTHER_UID)
        for process, topic, number in ((stranger, "/c", 9), (one, "/a", 9), (two, "/b", 5)):
            process.publisher(topic, kept).publish_many(f"{at:700}" for at in range(number))
        user = world.broker._quotas.users[UID]
        assert 10_000 < user.history.used <= 12_000
        late = world.process()
        got = [[int(text) for text in late.subscription(f"/{name}", kept).payloads] for name in "abc"]
        assert got[1:] == [list(range(5)), list(range(9))]
        assert 0 < len(got[0]) < 9
        assert got[0][-1] == 8
        one.die()
        two.die()
        assert user.history.used == 0

    @pytest.mark.parametrize("what", ["queued", "history"])
    def test_where_the_one_with_most_can_not_make_room_alone(self, what: str) -> None:
        """It has only samples that have just arrived, which busd does not drop. So the next one loses its
        oldest samples.
        """
        world = world_of(**{**TIGHT, "message_bytes": 8000, "keep_all_window_bytes": 8000})
        kept = QoSProfile(depth=100, durability="transient_local")
        talker, asker = world.process(uid=OTHER_UID), world.process()
        if what == "queued":
            sleepers = [self.sleeper(world, f"/{name}") for name in "ab"]
            many, long = (talker.publisher(one) for one in ("/a", "/b"))
        else:
            many, long = (world.process().publisher(one, kept) for one in ("/a", "/b"))
        many.publish_many(f"{at:700}" for at in range(6))
        long.publish("x" * 7900)
        user = next(one for one in asker.request(m.GetPeers(request=0), m.Peers).users if one.uid == UID)
        used = user.queued_bytes if what == "queued" else user.history_bytes
        assert 11_000 < used <= 12_000
        if what == "queued":
            for sleeper in sleepers:
                sleeper.process.unblock()
            world.carry_out([])
            got = [one.payloads for one in sleepers]
        else:
            got = [asker.subscription(one, kept).payloads for one in ("/a", "/b")]
        numbers = [int(text) for text in got[0]]
        assert (numbers, got[1]) == (list(range(6))[-len(numbers) :], ["x" * 7900])
        assert 0 < len(numbers) < 6

    def test_many_queues_lose_a_little_more_at_once(self) -> None:
        world = world_of(**TIGHT)
        process = world.process()
        keep_all = QoSProfile(history="keep_all", reliability="best_effort")
        for at in range(100):
            process.subscription(f"/t{at}", keep_all)
        process.is_blocked = True
        publisher = world.process().publisher("/t0")
        used = []
        for at in range(12):
            publisher.publish(f"{at:700}")
            used.append(world.broker._peers[process.id].queued.used)
        assert max(used) <= 10_000
        assert min(used[9:]) <= 10_000 * 15 // 16


class TestReconfigure:
    def renew(self, world: World, **limits: float) -> None:
        access = Access(UID, (ALL_MAY,))
        new = Limits(**limits)  # type: ignore[arg-type]
        world.carry_out(world.broker.reconfigure(world.now_ns, new, (), access))

    def test_more_may_come(self) -> None:
        world = world_of(endpoints_per_peer=1, topics=1)
        process = world.process()
        process.publisher("/a")
        with pytest.raises(Refusal):
            process.publisher("/b")
        self.renew(world, endpoints_per_peer=2)
        process.publisher("/b")
        assert process.request(m.GetPeers(request=0), m.Peers).limits["endpoints_per_peer"] == 2
        assert world.broker.settings.limits.endpoints_per_peer == 2

    def test_what_is_there_stays(self) -> None:
        world = world_of()
        process = world.process()
        one, two = process.publisher("/a"), process.subscription("/a")
        self.renew(world, endpoints_per_peer=1)
        one.publish("still here")
        assert two.payloads == ["still here"]
        with pytest.raises(Refusal, match="endpoints of a process: 2 of 1 in use"):
            process.publisher("/b")

    @pytest.mark.parametrize("whose", ["peer", "user"])
    def test_queues_are_trimmed(self, whose: str) -> None:
        world = world_of(history_bytes_per_peer=64_000)  # so little that busd gathers no runs
        process = world.process()
        keep_all = QoSProfile(history="keep_all", reliability="best_effort")
        subscriptions = [process.subscription(f"/t{at}", keep_all) for at in range(3)]
        process.is_blocked = True
        kept = QoSProfile(depth=100, durability="transient_local")
        talker = world.process()
        for at in range(3):
            talker.publisher(f"/t{at}", kept).publish_many(f"{n:700}" for n in range(20))
        sizes = {"queued_bytes_per_peer": 10_000, "history_bytes_per_peer": 8_000}
        if whose == "user":
            sizes |= {name.replace("peer", "user"): value for name, value in sizes.items()}
        self.renew(world, message_bytes=1024, keep_all_window_bytes=1024, **sizes)
        user = world.broker._quotas.users[UID]
        assert 5_000 < user.queued.used <= 10_000
        assert 4_000 < user.history.used <= 8_000
        process.unblock()
        world.carry_out([])
        for subscription in subscriptions:
            numbers = [int(text) for text in subscription.payloads]
            assert numbers == list(range(20 - len(numbers), 20))
            assert subscription.statistics(talker).dropped == {"memory_limit": 20 - len(numbers)}

    def test_a_lease_is_what_a_process_was_told(self) -> None:
        world = world_of(lease_s=10)
        old = world.process()
        self.renew(world, lease_s=2)
        new = world.process()
        world.advance(5)
        assert [world.broker._peers[one.id].is_silent for one in (old, new)] == [False, True]
        world.advance(5.1)
        assert world.broker._peers[old.id].is_silent

    def test_a_larger_window_does_not_starve_who_has_a_small_one(self) -> None:
        """A publisher that knows a window of 8 samples must get credit for each of them."""
        world = world_of(keep_all_window_messages=8)
        talker = world.process()
        publisher = talker.publisher("/topic", QoSProfile(history="keep_all"))
        self.renew(world, keep_all_window_messages=1000)
        publisher.publish_many("12345678")
        assert publisher.got(m.Credit)[-1].seq >= 7
