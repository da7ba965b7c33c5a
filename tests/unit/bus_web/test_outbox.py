"""The queue of a slow client: its order, its bound, its drops."""

from hypothesis import given
from hypothesis import strategies as st

from bus_web.outbox import Outbox, SharedBudget


def drain(outbox: Outbox) -> list[bytes]:
    taken = []
    while (frame := outbox.take()) is not None:
        taken.append(frame)
    return taken


def test_in_order() -> None:
    outbox = Outbox(100)
    outbox.put("/a", b"1")
    outbox.notify(b"2")
    outbox.put("/b", b"3")
    outbox.put("/a", b"4")
    assert (len(outbox), outbox.bytes, outbox.notices) == (4, 4, 1)
    assert drain(outbox) == [b"1", b"2", b"3", b"4"]
    assert (len(outbox), outbox.bytes, outbox.notices, outbox.dropped) == (0, 0, 0, {})


def test_the_oldest_of_the_topic_with_most_bytes_go() -> None:
    outbox = Outbox(100)
    outbox.put("/small", b"s1")
    outbox.put("/small", b"s2")
    for number in range(9):
        outbox.put("/large", b"%d" % number * 30)
    outbox.put("/small", b"s3")
    assert drain(outbox) == [b"s1", b"s2", b"6" * 30, b"7" * 30, b"8" * 30, b"s3"]
    assert outbox.dropped == {"/large": 6}


def test_the_newest_of_each_stays_as_long_as_it_can() -> None:
    outbox = Outbox(100)
    outbox.put("/a", b"a" * 60)
    outbox.put("/b", b"b" * 30)
    outbox.put("/b", b"c" * 30)  # /a has the most bytes, but no other message
    assert drain(outbox) == [b"a" * 60, b"c" * 30]
    outbox.put("/a", b"a" * 60)
    outbox.put("/b", b"b" * 60)
    assert drain(outbox) == [b"b" * 60]
    assert outbox.dropped == {"/a": 1, "/b": 1}


def test_one_that_is_larger_than_all_goes_alone() -> None:
    outbox = Outbox(100)
    outbox.put("/a", b"a")
    outbox.put("/image", b"x" * 1000)
    assert drain(outbox) == [b"x" * 1000]


def test_notices_are_never_dropped() -> None:
    outbox = Outbox(10)
    outbox.notify(b"n" * 20)
    outbox.put("/a", b"a")
    outbox.put("/a", b"b")
    assert drain(outbox) == [b"n" * 20, b"b"]


def test_what_nobody_looks_at_any_more() -> None:
    outbox = Outbox(100)
    for topic in ("/a", "/b", "/a"):
        outbox.put(topic, topic.encode())
    outbox.forget("/a")
    outbox.forget("/a")
    assert (drain(outbox), outbox.bytes) == ([b"/b"], 0)


@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 120))), st.integers(0, 5))
def test_it_never_holds_more_and_the_account_closes(puts: list[tuple[str, int]], each: int) -> None:
    outbox, taken = Outbox(100), 0
    for number, (topic, size) in enumerate(puts):
        outbox.put(topic, bytes(size))
        assert outbox.bytes <= 100 or len(outbox) == 1
        if each and number % each == 0:
            taken += outbox.take() is not None
    newest = dict(puts)
    rest = drain(outbox)
    assert taken + len(rest) + outbox.dropped.total() == len(puts)
    if puts and not (each and (len(puts) - 1) % each == 0):
        assert len(rest[-1]) == newest[puts[-1][0]]


class TestAllClients:
    def test_the_one_for_which_most_waits_loses(self) -> None:
        shared = SharedBudget(100)
        deaf, slow, quick = (Outbox(80, shared) for _ in range(3))
        for number in range(7):
            deaf.put("/a", b"%d" % number * 10)
        slow.put("/a", b"s" * 20)
        quick.put("/a", b"q" * 10)
        assert not deaf.dropped
        quick.put("/b", b"Q" * 10)
        assert (shared.bytes, deaf.dropped) == (100, {"/a": 1})
        assert not slow.dropped
        assert drain(quick) == [b"q" * 10, b"Q" * 10]
        assert drain(slow) == [b"s" * 20]

    def test_one_large_message_each_is_too_much(self) -> None:
        shared = SharedBudget(100)
        outboxes = [Outbox(80, shared) for _ in range(4)]
        for outbox in outboxes:
            outbox.put("/image", b"x" * 70)
        assert [len(outbox) for outbox in outboxes] == [0, 0, 0, 1]
        outboxes[3].put("/image", b"y" * 1000)  # no other message can be dropped
        assert drain(outboxes[3]) == [b"y" * 1000]

    def test_what_is_of_no_topic_stays(self) -> None:
        shared = SharedBudget(10)
        first, second = Outbox(80, shared), Outbox(80, shared)
        first.notify(b"n" * 50)
        second.put("/a", b"a")
        assert (len(first), len(second)) == (1, 1)

    def test_a_large_notice_costs_others_no_message(self) -> None:
        shared = SharedBudget(10)
        first, second = Outbox(80, shared), Outbox(80, shared)
        first.notify(b"n" * 50)
        for text in (b"a", b"b", b"c"):
            second.put("/a", text)
        assert (shared.bytes, drain(second), second.dropped) == (3, [b"a", b"b", b"c"], {})

    def test_one_that_has_gone_takes_no_room(self) -> None:
        shared = SharedBudget(100)
        gone, there = Outbox(100, shared), Outbox(100, shared)
        gone.put("/a", b"a" * 90)
        gone.close()
        gone.close()
        there.put("/a", b"b" * 90)
        assert (shared.bytes, len(there)) == (90, 1)
