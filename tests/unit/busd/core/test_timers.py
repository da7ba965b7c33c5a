"""busd.core.timers: due timers, and their order."""

from collections.abc import Callable

from hypothesis import given, settings
from hypothesis import strategies as st

from busd.core.timers import NEVER_NS, Timers


def run_due(timers: Timers, now_ns: int) -> None:
    for action in timers.due(now_ns):
        action(now_ns)


def test_nothing_to_do() -> None:
    timers = Timers()
    assert timers.earliest_ns == NEVER_NS
    assert list(timers.due(10**18)) == []


def test_due_at_its_time_and_once() -> None:
    timers, done = Timers(), list[int]()
    timers.add(100, done.append)
    assert timers.earliest_ns == 100
    run_due(timers, 99)
    assert done == []
    run_due(timers, 100)
    run_due(timers, 101)
    assert done == [100]
    assert timers.earliest_ns == NEVER_NS


def test_the_same_time_keeps_the_order() -> None:
    timers, done = Timers(), list[str]()

    def action(name: str) -> Callable[[int], None]:
        return lambda now_ns: done.append(name)

    for name in "abc":
        timers.add(5, action(name))
    run_due(timers, 5)
    assert done == ["a", "b", "c"]


def test_an_action_may_add_another() -> None:
    timers, done = Timers(), list[int]()

    def again(now_ns: int) -> None:
        done.append(now_ns)
        timers.add(now_ns + 10, again)

    timers.add(10, again)
    run_due(timers, 10)
    run_due(timers, 20)
    assert done == [10, 20]
    assert timers.earliest_ns == 30


@settings(deadline=None)
@given(st.lists(st.integers(0, 50)), st.lists(st.integers(0, 50)))
def test_against_a_sorted_list(dues: list[int], looks: list[int]) -> None:
    timers, ran = Timers(), list[int]()
    for due_ns in dues:
        timers.add(due_ns, lambda _, due_ns=due_ns: ran.append(due_ns))  # type: ignore[misc]
    last = -1
    for now_ns in sorted(looks):
        before = len(ran)
        run_due(timers, now_ns)
        assert ran[before:] == sorted(due for due in dues if last < due <= now_ns)
        last = now_ns
    waiting = [due for due in dues if due > last]
    assert timers.earliest_ns == min(waiting, default=NEVER_NS)
