from bus_bridge.core.accounts import Account
from bus_bridge.core.pasts import Past, Pasts


def past(last: int) -> Past:
    return Past(last, frozenset(), Account(), {})


def test_who_is_back_finds_where_it_ended_once() -> None:
    pasts, known = Pasts(), past(7)
    pasts.keep(b"a", known, 1.0)
    assert pasts.take(b"b", 2.0) is None
    assert pasts.take(b"a", 2.0) is known
    assert pasts.take(b"a", 2.0) is None


def test_the_oldest_go() -> None:
    pasts, known = Pasts(most=2, keep_s=10), [past(number) for number in range(4)]
    for number, gid in enumerate((b"a", b"b", b"a", b"c")):  # `a` left twice
        pasts.keep(gid, known[number], number)
    assert pasts.take(b"b", 4) is None
    assert pasts.take(b"a", 4) is known[2]
    assert pasts.take(b"c", 13.5) is None
