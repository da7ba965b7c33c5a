"""The plan and the judge of `tests/chaos`. A judge that never complains would pass everything."""

from copy import deepcopy
from dataclasses import replace

import pytest

from chaos import judge
from chaos.deeds import Cut, Doze, Enter, Kill, Leave, Resume
from chaos.judge import Said, Scene
from chaos.plan import Plan
from chaos.roles import Ear, EarLook, Heard, Quality, Role, Talker
from chaos.stories import CGROUP, CROWD, DOZERS, FAREWELL
from rows import for_each

STREAM, LATCHED = Quality(), Quality(10, is_durable=True)


def scene(
    published: int, heard: int, *, quality: Quality = STREAM, dropped: int = 0, deaths: int = 0
) -> Scene:
    """One talker, 1, and one ear, 2. Each has its own process."""
    look = EarLook(heard, 0, {"replaced": dropped} if dropped else {}, heard + dropped, {})
    if heard:
        look.heard[1] = Heard(heard, 1, heard + dropped, dropped)
    talker = Talker(1, "/t", quality, (8, 8), 1, 0.0)
    return Scene(
        talkers={1: Said(talker, "mouth", published, published)},
        ears={2: (Ear(2, "/t", quality), "ears", look)},
        losses={"mouth": deaths, "ears": deaths},
        deaths=deaths,
        roles={"mouth": Role("mouth", ()), "ears": Role("ears", ())},
    )


class TestPlan:
    def test_a_seed_repeats_it(self) -> None:
        first, second, other = (Plan(seed) for seed in (7, 7, 8))
        assert first.cast == second.cast
        scripts = [[one.storm(5) for _ in range(3)] for one in (first, second, other)]
        assert scripts[0] == scripts[1] != scripts[2]

    @pytest.mark.parametrize("spares_broker", [True, False])
    def test_what_is_done_is_done_to_those_that_are_there(self, spares_broker: bool) -> None:
        for seed in range(50):
            plan = Plan(seed)
            there = {role.name for role in plan.cast}
            for _, deed in plan.storm(20, spares_broker=spares_broker):
                if isinstance(deed, Enter):
                    assert deed.role.name not in there
                    there.add(deed.role.name)
                elif (name := getattr(deed, "name", None)) is not None:
                    assert name in there
                if isinstance(deed, Kill | Leave):
                    there.remove(deed.name)


class TestStories:
    def test_a_crowd_comes_is_killed_and_comes_back(self) -> None:
        script = [deed for _, deed in Plan(7, frozenset({CROWD})).storm(4, spares_broker=False)]

        first, second = (one for one in script if isinstance(one, Enter) and "crowd" in one.role.name)
        ends = first.role.endpoints
        ears = [one for one in ends if isinstance(one, Ear)]
        assert len(ears) * (len(ends) - len(ears)) == 2500
        (killed,) = (one for one in script if isinstance(one, Kill) and "crowd" in one.name)
        assert killed.name == first.role.name
        assert script.index(first) < script.index(killed) < script.index(second)

    def test_some_leave_while_listeners_sleep_which_are_cut_off_later(self) -> None:
        woken = 0
        for seed in range(50):
            plan = Plan(seed, frozenset({FAREWELL}))
            assert {role.name for role in plan.cast} >= {*DOZERS}
            script = plan.storm(4, spares_broker=True)
            leavers = [one.role for _, one in script if isinstance(one, Enter) and "leaver" in one.role.name]
            assert {role.by_socket for role in leavers} == {True, False}
            left_s = [at_s for at_s, one in script if isinstance(one, Leave) and "leaver" in one.name]
            assert len(left_s) == 2
            for name in DOZERS:
                deeds = [(at_s, one) for at_s, one in script if getattr(one, "name", "") == name]
                (slept_s, slept), *later = deeds
                assert isinstance(slept, Doze)
                assert slept_s < min(left_s)
                assert max(left_s) < min([at_s for at_s, _ in later] or [4])
                assert [type(one) for _, one in later] in ([], [Cut, Resume])
                woken += bool(later)
        assert 10 < woken < 90

    def test_one_has_little_memory_of_any_kind(self) -> None:
        script = Plan(7, frozenset({CGROUP})).storm(4)
        (confined,) = (one.role for _, one in script if isinstance(one, Enter) and one.role.cgroup_bytes)
        assert confined.is_limited

    def test_without_stories_nothing_of_them_happens(self) -> None:
        plan = Plan(7, frozenset())
        names = {role.name for role in plan.cast}
        for spares_broker in (True, False):
            script = plan.storm(4, spares_broker=spares_broker)
            names |= {one.role.name for _, one in script if isinstance(one, Enter)}
        assert not [
            name for name in names if name in DOZERS or name.startswith(("crowd", "leaver", "confined"))
        ]


class TestJudge:
    @pytest.mark.parametrize("quality", [STREAM, Quality(5)])
    def test_a_closed_account(self, quality: Quality) -> None:
        assert judge.judge(scene(10, 10, quality=quality), scene(30, 30, quality=quality)) == []

    def test_drops_with_a_reason(self) -> None:
        lossy = Quality(5)
        assert judge.judge(scene(10, 10, quality=lossy), scene(30, 25, dropped=5, quality=lossy)) == []

    @for_each(("heard", "dropped"), [(25, 0), (25, 4), (25, 6)])
    def test_one_that_does_not_close(self, heard: int, dropped: int) -> None:
        lossy = Quality(5)
        (complaint,) = judge.judge(
            scene(10, 10, quality=lossy), scene(30, heard, dropped=dropped, quality=lossy)
        )
        assert f"= {heard - 10 + dropped}, published 20" in complaint

    @for_each(("late_s", "count", "is_wrong"), [(14, 5, False), (14, 6, True), (16, 5, True)])
    def test_a_killed_talker_may_be_accounted_for_later(
        self, late_s: float, count: int, is_wrong: bool
    ) -> None:
        begin, killed = scene(10, 10, quality=LATCHED), scene(30, 25, quality=LATCHED)
        killed.talkers[1] = replace(killed.talkers[1], lives=False)
        killed.losses["ears"] = 1
        later = deepcopy(killed)
        later.at_s = late_s
        judge.note_unsettled(begin, killed)
        judge.note_unsettled(killed, later)
        now = deepcopy(later)
        now.ears[2][2].dropped["disconnected"] = count
        now.ears[2][2].expected += count
        del now.talkers[1]
        assert [*map(judge.judge, (begin, killed), (killed, later))] == [[], []]
        assert bool(judge.judge(later, now)) is is_wrong

    def test_a_stream_with_a_hole(self) -> None:
        complaints = judge.judge(scene(10, 10), scene(30, 25, dropped=5))
        assert complaints == ["ears, ear 2 on /t: 5 of 1 (mouth) are missing"]

    def test_a_stream_is_complete_also_when_busd_died(self) -> None:
        assert judge.judge(scene(10, 10), scene(30, 30, deaths=1)) == []
        assert judge.judge(scene(10, 10), scene(30, 25, dropped=5, deaths=1))

    @for_each(("dropped", "is_wrong"), [(4, True), (5, False), (6, False)])
    def test_a_gap_is_counted_also_by_socket_when_busd_died(self, dropped: int, is_wrong: bool) -> None:
        lossy = Quality(5)
        before, now = scene(10, 10, quality=lossy), scene(30, 25, dropped=5, quality=lossy, deaths=1)
        look = now.ears[2][2]
        look.dropped = {"disconnected": dropped}
        look.expected = 25 + dropped
        for one in (before, now):
            one.roles = {name: Role(name, (), by_socket=True) for name in one.roles}
        complaints = judge.judge(before, now)
        assert len(complaints) == is_wrong
        assert not is_wrong or "ears, ear 2 on /t: 5 missing between others" in complaints[0]
        now.losses["ears"] = 2  # a second loss while busd lived; the subscription may miss those samples
        assert judge.judge(before, now) == []

    def test_a_gap_that_was_counted_at_the_end_of_the_scene_before_is_not_owed_twice(self) -> None:
        lossy = Quality(5)
        before, now = scene(12, 10, quality=lossy), scene(30, 25, dropped=5, quality=lossy, deaths=1)
        for one in (before, now):
            one.roles = {name: Role(name, (), by_socket=True) for name in one.roles}
        then = before.ears[2][2]
        then.dropped, then.expected = {"expired": 2}, 12  # 11 and 12
        look = now.ears[2][2]
        look.dropped = {"expired": 2, "replaced": 3}
        assert judge.judge(before, now) == []
        look.dropped = {"expired": 2, "replaced": 2}
        look.expected -= 1
        (complaint,) = judge.judge(before, now)
        assert "3 missing between others, dropped {'replaced': 2}" in complaint

    def test_who_was_cut_off_may_miss_some(self) -> None:
        lossy = Quality(5)
        now = scene(30, 25, dropped=5, quality=lossy)
        now.losses["ears"] = 1
        assert judge.judge(scene(10, 10, quality=lossy), now) == []

    @pytest.mark.parametrize("whose", ["ears", "mouth"])
    def test_but_not_of_a_stream(self, whose: str) -> None:
        now = scene(30, 25, dropped=5)
        now.losses[whose] = 1
        now.roles = {name: Role(name, (), by_socket=True) for name in now.roles}
        assert judge.judge(scene(10, 10), now) == ["ears, ear 2 on /t: 5 of 1 (mouth) are missing"]
        now.sleepers.add(whose)
        assert judge.judge(scene(10, 10), now) == []

    def test_what_still_waits(self) -> None:
        now = scene(30, 30)
        now.ears[2][2].queued = 1
        assert any("1 messages still wait" in one for one in judge.judge(scene(10, 10), now))

    def test_its_own_account(self) -> None:
        now = scene(30, 30)
        now.ears[2][2].expected += 1
        assert judge.judge(scene(10, 10), now) == ["ears, ear 2 on /t: 31 expected, 30 accounted for"]

    def test_what_was_counted_and_not_delivered(self) -> None:
        now = scene(30, 30)
        now.ears[2][2].heard[1].messages -= 1
        assert any("30 counted as delivered, 29 were" in one for one in judge.judge(scene(10, 10), now))

    def test_of_the_dead_nobody_knows_it_exactly(self) -> None:
        lossy = Quality(5)
        before, now = scene(10, 10, quality=lossy), scene(30, 25, quality=lossy)
        now.talkers[1] = Said(now.talkers[1].talker, "mouth", 29, 30, lives=False)
        assert judge.judge(before, now) == []
        now.talkers[1] = Said(now.talkers[1].talker, "mouth", 20, 21, lives=False)
        assert judge.judge(before, now)  # it received more than were sent

    @for_each(("delivered", "dropped"), [(5, 0), (5, 14), (5, 16)])
    def test_who_left_in_order_owes_all_to_whom_it_was_connected(self, delivered: int, dropped: int) -> None:
        lossy = Quality(5)
        before, now = scene(0, 0, quality=lossy), scene(20, delivered, dropped=dropped, quality=lossy)
        del before.talkers[1]
        now.losses["ears"] = 1  # later
        now.talkers[1] = Said(now.talkers[1].talker, "mouth", 20, 20, lives=False)
        assert bool(judge.judge(before, now)) is (delivered + dropped > 20)
        now.talkers[1] = replace(now.talkers[1], witnesses=frozenset({"ears"}))
        assert judge.judge(before, now)
        right = scene(20, 5, dropped=15, quality=lossy)
        now.ears = right.ears
        assert judge.judge(before, now) == []

    def test_who_was_cut_off_by_a_busd_that_lived_has_no_more_than_there_was(self) -> None:
        lossy = Quality(5)
        before, now = scene(10, 10, quality=lossy), scene(30, 25, dropped=6, quality=lossy)
        now.losses["ears"] = 1
        now.roles["ears"] = Role("ears", (), by_socket=True)
        assert judge.judge(before, now)
        assert judge.judge(before, now, trusts_cut_off=False) == []
        now.deaths = now.losses["mouth"] = 1  # the counts of a killed busd are unknown
        assert judge.judge(before, now) == []

    def test_the_graph(self) -> None:
        found = scene(0, 0).graph()
        assert set(found) == {
            ("mouth",),
            ("ears",),
            ("mouth", "publisher", "/t"),
            ("ears", "subscription", "/t"),
        }


class TestHistory:
    @for_each(("published", "depth", "first"), [(30, 5, 26), (30, 100, 21), (30, 0, 21), (3, 5, 1)])
    def test_the_last_of_both_depths(self, published: int, depth: int, first: int) -> None:
        said = Said(Talker(1, "/t", LATCHED, (8, 8), 1, 0.0), "mouth", published, published)
        ear = Ear(2, "/t", Quality(depth, is_durable=True))
        number = published - first + 1
        look = EarLook(number, 0, {}, number, {1: Heard(number, first, published)})
        assert judge.history([said], ear, look) == []
        for field, change in (("first", -1), ("last", 1), ("missing", 1), ("messages", -1)):
            wrong = deepcopy(look)
            setattr(wrong.heard[1], field, getattr(wrong.heard[1], field) + change)
            assert judge.history([said], ear, wrong)

    def test_the_volatile_get_nothing(self) -> None:
        said = Said(Talker(1, "/t", LATCHED, (8, 8), 1, 0.0), "mouth", 30, 30)
        ear = Ear(2, "/t", STREAM)
        assert judge.history([said], ear, EarLook(0, 0, {}, 0, {})) == []
        assert judge.history([said], ear, EarLook(1, 0, {}, 1, {1: Heard(1, 30, 30)}))
