"""bus.shm's Writer: the reasons why it refuses to write, loans by its quick way, and its stamps."""

import os

import msgspec
import pytest

from bus.types.support import type_support
from rows import for_each
from shm_ends import Listener, Talker, core

MIB = 1 << 20


class Frame(msgspec.Struct):
    number: int = 0
    data: bytes = b""


INDEX = Frame.__struct_fields__.index("data")


def prepared(capacity: int = 1 << 18) -> Talker:
    talker = Talker(capacity)
    talker.writer.prepare(*type_support(Frame).steps)
    return talker


def test_nothing_is_published_while_a_loan_is_open() -> None:
    talker = prepared()
    place = talker.lend_field(Frame(1), INDEX, 3)
    assert talker.writer.is_lent
    assert talker.writer.publish(Frame(2)) is False
    assert talker.lend_field(Frame(2), INDEX, 3) is False
    place[:] = b"abc"
    assert talker.writer.publish_lent() is True
    assert not talker.writer.is_lent
    assert talker.writer.publish(Frame(2)) is True
    payloads = [payload for _, _, payload in talker.writer.since(0)]
    assert [type_support(Frame).decode(one) for one in payloads] == [Frame(1, b"abc"), Frame(2)]
    talker.close()


def test_a_loan_of_which_nothing_can_be_made_is_given_back() -> None:
    talker = prepared()
    with pytest.raises(ZeroDivisionError):
        talker.writer.lend_field(Frame(1), INDEX, 3, lambda place, end: len(place) // end, 0)
    assert not talker.writer.is_lent
    assert talker.writer.publish(Frame(2)) is True
    talker.close()


def test_a_loan_that_is_given_back_leaves_nothing() -> None:
    talker = prepared()
    assert talker.lend_field(Frame(1), INDEX, 3) is not False
    talker.writer.is_lent = False
    assert len(talker.writer.lent()) == 0
    assert talker.writer.publish(Frame(2)) is True
    with pytest.raises(ValueError, match="nothing is lent"):
        talker.writer.publish_lent()
    assert talker.writer.latest == 1
    talker.close()


def test_a_loan_that_is_given_back_can_not_be_published() -> None:
    talker = prepared()
    assert talker.lend_field(Frame(1), INDEX, 3) is not False
    talker.writer.is_lent = False
    with pytest.raises(ValueError, match="nothing is lent"):
        talker.writer.publish_lent()
    assert talker.writer.latest == 0
    talker.close()


def test_another_write_ends_the_loan() -> None:
    talker = prepared()
    assert talker.lend_field(Frame(1), INDEX, 3) is not False
    talker.writer.write_parts((b"abc",))
    assert len(talker.writer.lent()) == 0
    talker.close()


@for_each(
    ("index", "size"),
    [(-1, 3), (2, 3), (1 << 40, 3), (1 << 70, 3), (0, 3), (INDEX, -1), (INDEX, 1 << 70), (INDEX, 2.0)],
)
def test_what_can_not_be_lent_by_the_quick_way(index: int, size: int) -> None:
    talker = prepared()
    assert talker.lend_field(Frame(1), index, size) is False
    assert not talker.writer.is_lent
    assert talker.writer.publish(Frame(2)) is True
    talker.close()


def test_a_loan_of_more_than_the_limit_stays_open_and_may_be_given_back() -> None:
    talker = prepared()
    assert len(talker.lend_field(Frame(1), INDEX, 3_000)) == 3_000
    talker.writer.most = 1_000
    assert talker.writer.publish_lent() == core.TOO_LARGE
    assert talker.writer.is_lent
    assert talker.writer.latest == 0
    talker.writer.is_lent = False
    assert talker.writer.publish(Frame(2)) is True
    assert talker.lend_field(Frame(1), INDEX, 3_000) == core.TOO_LARGE
    talker.close()


def test_a_loan_is_refused_by_both_ways_where_hold_is_out_of_date() -> None:
    """Otherwise no caller would learn from the quick way that `hold` must move."""
    talker, listener = prepared(16 * MIB), Listener(tells_cursor=True)
    listener.join(talker, start=1)
    talker.writer.hold = 1
    size = MIB // 2
    while (place := talker.lend_field(Frame(), INDEX, size)) != core.HELD:
        del place
        assert talker.writer.publish_lent() is True
        assert len(listener.take()) == 1
    assert talker.writer.lend(size) == core.HELD
    talker.writer.hold = talker.writer.latest + 1
    place = talker.lend_field(Frame(), INDEX, size)
    assert len(place) == size
    talker.close()
    listener.close()


def test_without_a_hold_nobody_is_asked_to_move_it() -> None:
    talker, listener = Talker(16 * MIB), Listener(tells_cursor=True)
    listener.join(talker, start=1)
    while (outcome := talker.writer.write_parts([bytes(MIB // 2)])) is True:
        pass
    assert outcome == core.FULL
    talker.close()
    listener.close()


def test_stamps_never_go_back() -> None:
    talker = Talker()
    for stamp_ns in (10, 30, 20, 40):
        assert talker.writer.write_parts([b"x"], stamp_ns=stamp_ns) is True
    assert [stamp_ns for _, stamp_ns, _ in talker.writer.since(0)] == [10, 30, 30, 40]
    talker.close()


def test_the_child_of_a_fork_writes_nothing() -> None:
    talker = prepared()
    place = talker.lend_field(Frame(1), INDEX, 3)
    if (child := os.fork()) == 0:
        outcomes = [
            talker.writer.write(b"x"),
            talker.writer.publish_lent(),
            talker.writer.write_parts([b"x"]),
        ]
        os._exit(outcomes != [core.WRONG_THREAD] * 3)
    assert os.waitpid(child, 0)[1] == 0
    assert talker.writer.latest == 0
    place[:] = b"abc"
    assert talker.writer.publish_lent() is True
    talker.close()


def test_hold_goes_with_it_into_another_ring() -> None:
    talker = Talker(1 << 16)
    talker.write(b"1", b"2", b"3")
    talker.writer.hold = 2
    talker.grow(1 << 17)
    assert talker.writer.hold == 2
    while (outcome := talker.writer.write(bytes(4_000))) is True:
        pass
    assert outcome == core.FULL
    assert talker.writer.oldest <= 2
    talker.close()
