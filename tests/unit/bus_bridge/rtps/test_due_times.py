"""Times at which entities are due: changed, void and gone ones."""

from bus_bridge.rtps.due_times import DueTimes


class Ends:
    """Entities with the times at which they are due."""

    def __init__(self) -> None:
        self.due = DueTimes()
        self.times: dict[bytes, int | None] = {}
        self.asked: list[bytes] = []

    def set(self, entity: bytes, due_ns: int | None) -> None:
        self.times[entity] = due_ns
        self.due.touch(entity)

    def settle(self) -> None:
        self.due.settle(self.ask)

    def ask(self, entity: bytes) -> int | None:
        self.asked.append(entity)
        return self.times.get(entity)


def test_each_is_due_once_in_the_order_of_the_times() -> None:
    ends = Ends()
    for entity, due_ns in ((b"a", 30), (b"b", 10), (b"c", 20), (b"d", None)):
        ends.set(entity, due_ns)
    assert ends.due.first_ns is None  # nothing counts before the turn has ended
    ends.settle()
    assert ends.due.first_ns == 10
    assert [*ends.due.take_due(20)] == [b"b", b"c"]
    assert ends.due.first_ns == 30


def test_one_that_was_due_is_asked_again() -> None:
    ends = Ends()
    ends.set(b"a", 10)
    ends.settle()
    assert [*ends.due.take_due(10)] == [b"a"]
    ends.times[b"a"] = 15
    ends.settle()
    assert ends.asked == [b"a", b"a"] and ends.due.first_ns == 15


def test_the_newest_time_counts() -> None:
    ends = Ends()
    ends.set(b"a", 10)
    ends.settle()
    ends.set(b"a", 50)
    ends.settle()
    assert [*ends.due.take_due(40)] == []
    ends.set(b"a", 45)
    ends.settle()
    assert [*ends.due.take_due(50)] == [b"a"]


def test_one_that_has_gone_is_not_due() -> None:
    ends = Ends()
    ends.set(b"a", 10)
    ends.settle()
    ends.set(b"a", None)
    ends.settle()
    assert [*ends.due.take_due(99)] == []


def test_void_entries_are_thrown_away() -> None:
    """An entity whose time changes a million times takes no more memory than another one."""
    ends = Ends()
    for due_ns in range(2000, 1000, -1):
        ends.set(b"a", due_ns)
        ends.settle()
    assert ends.due.first_ns == 1001 and len(ends.due._plan) < 100
    assert [*ends.due.take_due(3000)] == [b"a"]
