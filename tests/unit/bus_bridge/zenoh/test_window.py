"""The parts that a publisher's way out keeps, and for how long."""

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus_bridge.batch import Sample
from bus_bridge.zenoh.records import PART_BYTES, WHOLE_BYTES, Assembler, Part, Piece, Probe, Room, read_part
from bus_bridge.zenoh.window import HISTORY_BYTES, WINDOW_BYTES, History, Window

SIZE = 1000


def fill(window: Window, size: int = SIZE) -> int:
    """Add parts until there is no room. Returns the number of the last one."""
    while window.room > 0:
        window.add(Part(bytes(size), window.last + 1, b""))
    return window.last


def send(window: Window, count: int) -> None:
    for _ in range(count):
        window.add(Part(bytes(SIZE), window.last + 1, b""))


def test_without_an_importer_nothing_is_kept() -> None:
    window = Window(lossless=True)
    send(window, 9999)
    assert window.in_flight == 0 and window.room > 0


def test_a_lossless_window_is_full_until_the_slowest_has_taken() -> None:
    window = Window(lossless=True)
    window.join("a")
    window.join("b")
    last = 0
    while (more := fill(window)) > last:
        window.acknowledge("a", more, more)
        window.acknowledge("b", more, 0)  # it has arrived there, and is not taken
        last = more
    assert WINDOW_BYTES <= window.in_flight < WINDOW_BYTES + 2 * SIZE
    assert window.acknowledge("b", last, last)
    assert window.in_flight == 0 and window.room > 0


def test_an_importer_that_goes_is_waited_for_no_more() -> None:
    window = Window(lossless=False)
    window.join("a")
    window.join("hung")
    last = fill(window)
    window.acknowledge("a", last, last)
    assert window.room <= 0
    window.leave("hung")
    assert window.in_flight == 0 and window.room > 0


def test_of_other_routes_arrival_is_enough() -> None:
    window = Window(lossless=False)
    window.join("a")
    window.acknowledge("a", fill(window), 0)
    assert window.in_flight == 0


def test_what_is_missing_is_found_and_less_goes_at_a_time() -> None:
    window = Window(lossless=True)
    window.join("a")
    last = fill(window)
    window.acknowledge("a", 10, 0)
    found = window.find("a", 10)
    assert found is not None and found.number == 11
    assert window.find("a", last) is None
    assert window.find("stranger", 0) is None
    window.acknowledge("a", last, last)
    assert fill(window) - last < last * 3 / 4


def test_it_grows_again() -> None:
    window = Window(lossless=False)
    window.join("a")
    first = last = fill(window)
    for _ in range(100):
        window.acknowledge("a", last, 0)
        before, last = last, fill(window)
    assert 2 * first < last - before <= WINDOW_BYTES / SIZE


def spans(window: Window, count: int) -> list[int]:
    """The bytes that may be in flight at once; each time after everything has arrived."""
    found = list[int]()
    for _ in range(count):
        found.append(window.room)
        window.acknowledge("a", fill(window), 0)
    return found


def test_until_something_is_dropped_it_doubles_with_each_round() -> None:
    window = Window(lossless=False)
    window.join("a")
    first, second, third, *_ = spans(window, 4)
    assert (second / first, third / second) == (pytest.approx(2, rel=0.01), pytest.approx(2, rel=0.01))


def test_after_a_loss_it_grows_step_by_step() -> None:
    window = Window(lossless=False)
    window.join("a")
    spans(window, 3)
    before = window.room
    last = fill(window)
    window.find("a", last - 1)  # the last part was dropped
    window.acknowledge("a", last, 0)
    first, second, *_ = spans(window, 2)
    assert first == pytest.approx(before / 2, rel=0.1)
    assert 0 < second - first < first / 8


def test_many_losses_at_once_make_it_shrink_once() -> None:
    one, many = Window(lossless=False), Window(lossless=False)
    for window, dropped in ((one, 1), (many, 20)):
        window.join("a")
        last = fill(window)
        window.acknowledge("a", 10, 0)
        for number in range(10, 10 + dropped):
            assert window.find("a", number) is not None
            window.acknowledge("a", number + 1, 0)
        window.acknowledge("a", last, 0)
    before = one.room
    assert before == pytest.approx(many.room, rel=0.05)
    fill(many)
    many.acknowledge("a", many.last - 1, 0)  # a loss after everything that was in flight then
    assert many.find("a", many.last - 1) is not None
    many.acknowledge("a", many.last, 0)
    assert many.room == pytest.approx(before / 2, rel=0.1)


def test_parts_are_small_where_little_may_be_on_its_way() -> None:
    window = Window(lossless=False)
    window.join("a")
    while window.part_bytes < WHOLE_BYTES:
        before = window.part_bytes
        fill(window)
        window.acknowledge("a", window.last, window.last)
        assert before <= window.part_bytes <= WHOLE_BYTES
    for _ in range(10):
        fill(window)
        window.find("a", window.last - 1)  # this part was dropped
        window.acknowledge("a", window.last, window.last)
    assert window.part_bytes == 2 * PART_BYTES


def test_importers_get_only_what_came_after_them() -> None:
    window = Window(lossless=False)
    window.join("a")
    send(window, 5)
    window.join("late")
    send(window, 2)
    found = window.find("late", 0)
    assert found is not None and found.number == 6
    assert (window.joined("a"), window.joined("late"), window.joined("stranger")) == (0, 5, None)


def test_numbers_that_were_never_sent_count_as_the_newest() -> None:
    window = Window(lossless=True)
    window.join("a")
    send(window, 3)
    assert window.acknowledge("a", 2**64 - 1, 2**64 - 1)
    assert window.in_flight == 0
    send(window, 1)
    assert window.in_flight > SIZE
    assert not window.acknowledge("a", 1, 1)
    assert not window.acknowledge("stranger", 4, 4)
    assert window.acknowledge("a", 4, 0) and window.in_flight > SIZE


def test_importers_are_asked_a_few_times_in_a_span() -> None:
    window = Window(lossless=False)
    window.join("a")
    asked = 0
    while window.room > 0:
        asked += window.add(Part(bytes(SIZE), window.last + 1, b""))
    assert 3 <= asked <= 4


# --- history


@given(st.integers(0, 10**9), st.booleans())
def test_what_it_keeps_and_counts_is_what_some_importer_lacks(seed: int, lossless: bool) -> None:
    chance = Random(seed)
    window = Window(lossless=lossless)
    parts: list[Part] = []
    known: dict[str, list[int]] = {}
    """For each importer: the number at which it joined, the position of its bridge, and the position of its
    bus.
    """

    def lacked(which: int) -> list[Part]:
        return [one for one in parts if one.number > min(of[which] for of in known.values())] if known else []

    def size(some: list[Part]) -> int:
        return sum(len(one.payload) + 64 for one in some)

    for _ in range(100):
        who = chance.choice("abc")
        match chance.choice(("add", "add", "add", "join", "leave", "hear", "hear", "find")):
            case "add":
                parts.append(Part(bytes(chance.choice((0, 1, 5000))), window.last + 1, b""))
                window.add(parts[-1])
                parts = parts if known else []
            case "join" if who not in known:
                window.join(who)
                known[who] = [window.last] * 3
            case "leave":
                window.leave(who)
                known.pop(who, None)
            case "hear":
                arrived, taken = (chance.randint(0, window.last + 3) for _ in range(2))
                old = known.get(who, [0, 0, 0])
                arrived = max(old[1], min(arrived, window.last))
                taken = max(old[2], min(taken, arrived))
                assert window.acknowledge(who, arrived, taken) is (
                    who in known and [arrived, taken] != old[1:]
                )
                if who in known:
                    known[who] = [old[0], arrived, taken]
            case "find":
                after = chance.randint(0, window.last + 1)
                kept = lacked(2 if lossless else 1)
                wanted = (
                    next((one for one in kept if one.number > max(after, known[who][0])), None)
                    if who in known
                    else None
                )
                assert window.find(who, after) == wanted
        assert window.in_flight == size(lacked(2 if lossless else 1))
        assert window._travelling == size(lacked(1))


def read(history: History) -> list[int]:
    """Read like an importer. Returns the numbers of the messages."""
    after, found = 0, list[int]()
    assembler = Assembler(Room(1 << 30))
    while (part := history.find(after, assembler.size, history.last)) is not None:
        assert len(part.payload) <= PART_BYTES
        content = read_part(part.payload, part.head)
        assert content is not None
        if isinstance(content[1], Piece):
            whole = assembler.add(content[1])
            samples = [] if whole is None else [whole]
        else:
            assert not isinstance(content[1], Probe)
            samples = list(content[1])
        found += [one.number for one in samples]
        after = found[-1] if found else 0
    return found


def some(first: int, last: int, size: int = SIZE) -> list[Sample]:
    return [Sample(bytes(size), number, 0) for number in range(first, last + 1)]


def test_a_history_has_the_last_messages_small_and_large() -> None:
    history = History(5)
    assert read(history) == []
    history.add(some(1, 5))
    history.add(some(6, 6, 300_000))
    history.add(some(7, 8))
    assert read(history) == [4, 5, 6, 7, 8]
    many = History(1000)
    many.add(some(1, 2000))
    assert read(many) == list(range(1001, 2001))


def test_a_history_is_bounded_in_bytes() -> None:
    history = History(1000)
    history.add(some(1, 10, HISTORY_BYTES // 4))
    assert read(history) == [7, 8, 9, 10]
    history.add(some(11, 11, 2 * HISTORY_BYTES))
    assert read(history) == [11]


def test_a_message_that_has_gone_while_it_was_read_is_left_out() -> None:
    history = History(1)
    history.add(some(1, 1, 300_000))
    assert history.find(0, PART_BYTES, 1) is not None
    history.add(some(2, 2, 100_000))
    part = history.find(0, 4 * PART_BYTES, 2)
    assert part is not None
    content = read_part(part.payload, part.head)
    assert content is not None and isinstance(content[1], Piece)
    assert (content[1].number, content[1].offset) == (2, 0)
