"""bus_cli.metrics.sums: sums that grow, sums that stay when endpoints go, and rows without room."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.wire.messages import EndpointRecord
from bus_cli.metrics import sums as module
from bus_cli.metrics.sums import Labels, Sums, Totals
from metrics_views import PUBLISHER, SUBSCRIPTION, endpoint, graph


def take(totals: Totals, *endpoints: EndpointRecord) -> None:
    seen = graph(*endpoints)
    totals.take(seen.publishers, seen.subscriptions)


def test_amounts_are_added() -> None:
    sums = Sums(10)
    sums.add({("a",): 3, ("b",): 0})
    sums.add({("a",): 4, ("b",): 1})
    assert sums.rows == {("a",): 7, ("b",): 1}


def test_a_row_stays_when_its_subject_goes() -> None:
    sums = Sums(10)
    sums.add({("a",): 3})
    sums.add({("b",): 1})
    assert sums.rows == {("a",): 3, ("b",): 1}
    sums.add({("a",): 1})
    assert sums.rows[("a",)] == 4


def test_the_longest_gone_makes_room() -> None:
    sums = Sums(2)
    sums.add({("a",): 1, ("b",): 1})
    sums.add({("b",): 1})
    sums.add({("b",): 1, ("c",): 1})
    assert sums.rows == {("b",): 3, ("c",): 1}
    assert sums.left_out == 0


def test_who_is_there_keeps_its_row() -> None:
    sums = Sums(2)
    sums.add({("a",): 1, ("b",): 1})
    sums.add({("c",): 5, ("d",): 5, ("a",): 1, ("b",): 1})
    assert sums.rows == {("a",): 2, ("b",): 2}
    assert sums.left_out == 2
    sums.add({("a",): 1})
    assert sums.left_out == 0


_AMOUNTS = st.dictionaries(st.tuples(st.sampled_from("abcdefgh")), st.integers(0, 5), max_size=6)


@given(st.lists(_AMOUNTS, max_size=12), st.integers(1, 5))
def test_rows_are_bounded_and_never_go_back(moments: list[dict[Labels, int]], most: int) -> None:
    sums = Sums(most)
    for amounts in moments:
        before = sums.rows
        kept = before.keys() & amounts.keys()
        expected = {labels: before[labels] + amounts[labels] for labels in kept}
        sums.add(amounts)
        assert len(sums.rows) <= most
        assert {labels: sums.rows[labels] for labels in kept} == expected
        shown = amounts.keys() & sums.rows.keys()
        assert sums.left_out == len(amounts) - len(shown)


def test_totals_by_topic_and_node() -> None:
    totals = Totals(100)
    take(
        totals,
        endpoint(1, PUBLISHER, samples=5, size=50),
        endpoint(2, PUBLISHER, samples=7, size=70, node=2, replaced=2),
        endpoint(3, SUBSCRIPTION, node=3, samples=6, size=60, expected=12, replaced=4, expired=1),
        endpoint(4, SUBSCRIPTION, node=3, samples=12, size=120, expected=12),
    )
    assert totals.messages.rows == {("/chatter",): 12}
    assert totals.bytes.rows == {("/chatter",): 120}
    assert totals.dropped_early.rows == {("/chatter", "/n2", "replaced"): 2}
    assert totals.expected.rows == {("/chatter", "/n3"): 24}
    assert totals.delivered.rows == {("/chatter", "/n3"): 18}
    assert totals.delivered_bytes.rows == {("/chatter", "/n3"): 180}
    assert totals.lost.rows == {("/chatter", "/n3"): 5}
    assert totals.dropped.rows == {("/chatter", "/n3", "replaced"): 4, ("/chatter", "/n3", "expired"): 1}


def test_a_topic_goes_on_where_it_was() -> None:
    """Its publisher restarts: this is another endpoint, which counts from 0."""
    totals = Totals(100)
    take(totals, endpoint(1, PUBLISHER, samples=5))
    take(totals, endpoint(1, PUBLISHER, samples=8))
    take(totals)
    assert totals.messages.rows == {("/chatter",): 8}
    take(totals, endpoint(2, PUBLISHER, samples=1))
    assert totals.messages.rows == {("/chatter",): 9}


def test_a_new_busd_is_told_what_was_counted_before() -> None:
    """At a new busd, the same endpoint has another id. At first it has no counters, and later those of its
    whole life.
    """
    totals, gid = Totals(100), b"x" * 16
    take(totals, endpoint(7, SUBSCRIPTION, gid=gid, samples=100, replaced=9, expected=109))
    take(totals)
    take(totals, endpoint(1, SUBSCRIPTION, gid=gid))
    take(totals, endpoint(1, SUBSCRIPTION, gid=gid, samples=103, replaced=9, expected=112))
    assert totals.delivered.rows == {("/chatter", "/n1"): 103}
    assert totals.lost.rows == {("/chatter", "/n1"): 9}
    assert totals.expected.rows == {("/chatter", "/n1"): 112}


def test_two_endpoints_of_one_gid_do_not_count_for_ever() -> None:
    """No honest program has two endpoints of one gid."""
    totals, gid = Totals(100), b"x" * 16
    for _ in range(3):
        take(totals, endpoint(1, PUBLISHER, gid=gid, samples=5), endpoint(2, PUBLISHER, gid=gid, samples=5))
    assert totals.messages.rows == {("/chatter",): 10}


def test_what_is_remembered_of_those_that_are_gone_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST_GONE", 3)
    totals = Totals(100)
    for number in range(1, 20):
        take(totals, endpoint(number, PUBLISHER, samples=1))
    assert len(totals._heard) == 4
    assert totals.messages.rows == {("/chatter",): 19}
