"""bus.alarms.schedule: the calls that are due, and their order."""

from contextvars import copy_context

from hypothesis import given
from hypothesis import strategies as st

from bus.alarms.schedule import NEVER_NS, Alarm, Schedule

CONTEXT = copy_context()


def ring(schedule: Schedule, now_ns: int) -> None:
    for callback, _ in schedule.due(now_ns):
        callback()


def test_nothing_to_do() -> None:
    schedule = Schedule()
    assert schedule.earliest_ns == NEVER_NS
    assert not list(schedule.due(10**18))


def test_a_call_comes_once_at_its_time() -> None:
    schedule, calls = Schedule(), list[int]()
    schedule.add(100, lambda: calls.append(1), CONTEXT)
    ring(schedule, 99)
    assert (calls, schedule.earliest_ns, schedule.pending) == ([], 100, 1)
    ring(schedule, 100)
    ring(schedule, 101)
    assert (calls, schedule.earliest_ns, schedule.pending) == ([1], NEVER_NS, 0)


def test_an_alarm_that_a_call_adds_waits_for_the_next_time() -> None:
    """Otherwise, a period of 0 would keep the event loop busy for ever."""
    schedule, calls = Schedule(), list[str]()

    def again() -> None:
        calls.append("again")
        schedule.add(0, again, CONTEXT)

    again()
    schedule.add(5, lambda: calls.append("other"), CONTEXT)
    for now_ns in (4, 10, 11):
        ring(schedule, now_ns)
    assert calls == ["again", "again", "again", "other", "again"]


def test_a_call_cancels_the_next_one() -> None:
    schedule, calls = Schedule(), list[str]()
    alarms: list[Alarm] = []

    def call() -> None:
        calls.append("call")
        for alarm in alarms:
            alarm.cancel()

    alarms += [schedule.add(due_ns, call, CONTEXT) for due_ns in (1, 1, 2)]
    ring(schedule, 3)
    assert (calls, schedule.pending, schedule.earliest_ns) == (["call"], 0, NEVER_NS)


def test_an_exception_leaves_the_others_for_the_next_time() -> None:
    schedule, calls = Schedule(), list[int]()
    schedule.add(1, lambda: calls.append(1 // 0), CONTEXT)
    schedule.add(2, lambda: calls.append(2), CONTEXT)
    try:
        ring(schedule, 3)
    except ZeroDivisionError:
        calls.append(0)
    assert schedule.earliest_ns == 2
    ring(schedule, 3)
    assert calls == [0, 2]


def test_canceled_alarms_do_not_pile_up() -> None:
    """A program may postpone a watchdog with each message."""
    schedule = Schedule()
    kept = [schedule.add(10**9, int, CONTEXT) for _ in range(10)]
    for number in range(10_000):
        schedule.add(10**9 + number, int, CONTEXT).cancel()
    assert len(schedule._heap) < 200
    assert schedule.pending == len(kept)
    assert len(list(schedule.due(10**9))) == len(kept)


@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("add"), st.integers(0, 99)),
            st.tuples(st.just("cancel"), st.integers(0, 9)),
            st.tuples(st.just("ring"), st.integers(0, 9)),
        ),
        max_size=60,
    )
)
def test_as_a_sorted_list(steps: list[tuple[str, int]]) -> None:
    schedule = Schedule()
    alarms: dict[int, Alarm] = {}
    model: dict[int, int] = {}  # due times of pending alarms
    calls: list[int] = []
    now_ns = 0
    for number, (step, value) in enumerate(steps):
        if step == "add":
            alarms[number] = schedule.add(value, lambda number=number: calls.append(number), CONTEXT)
            model[number] = max(value, now_ns)
        elif step == "cancel" and alarms:
            chosen = list(alarms)[value % len(alarms)]
            alarms[chosen].cancel()
            model.pop(chosen, None)
        elif step == "ring":
            now_ns += value
            due = sorted((due_ns, one) for one, due_ns in model.items() if due_ns <= now_ns)
            calls.clear()
            ring(schedule, now_ns)
            assert calls == [one for _, one in due]
            for _, one in due:
                del model[one]
        assert schedule.pending == len(model)
        assert schedule.earliest_ns == min(model.values(), default=NEVER_NS)
