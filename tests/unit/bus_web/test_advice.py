"""Advice about the depth, and silence if the figures do not support any."""

from bus.graph import EndpointStatistics
from bus.qos import QoSProfile
from bus_web.advice import advice
from rows import for_each


def counters(replaced: int = 22, missed: int = 22, expected: int = 10_000) -> EndpointStatistics:
    dropped = {"replaced": replaced} if replaced else {}
    return EndpointStatistics(expected=expected, dropped=dropped, most_missed=missed)


def test_a_depth_that_holds_the_longest_stall() -> None:
    assert advice(QoSProfile(5), counters(), 190.0) == (
        "depth 5 at 190 Hz holds 26 ms; the longest stall was 142 ms: depth 27"
    )
    assert advice(QoSProfile(1), counters(missed=2), 4.0) == (
        "depth 1 at 4 Hz holds 250 ms; the longest stall was 750 ms: depth 3"
    )


def test_without_a_rate() -> None:
    text = "depth 5 was once too small by 22 messages: depth 27"
    assert [advice(QoSProfile(5), counters(), hz) for hz in (None, 0.0)] == [text, text]
    assert advice(QoSProfile(5), counters(1, 1)) == "depth 5 was once too small by 1 message: depth 6"


def test_a_program_that_may_be_too_slow() -> None:
    assert advice(QoSProfile(5), counters(3000), 190.0) == (
        "depth 5 at 190 Hz holds 26 ms; the longest stall was 142 ms: depth 27, "
        "if the program keeps up between its stalls"
    )
    assert advice(QoSProfile(5), counters(1001)) == (
        "depth 5 was once too small by 22 messages: depth 27, if the program keeps up between its stalls"
    )


def test_a_program_that_is_too_slow() -> None:
    assert advice(QoSProfile(5), counters(6000, 9), 190.0) == (
        "6000 of 10000 messages were replaced: the program takes too few, and no depth helps; "
        "do less for each message, or publish fewer"
    )


def test_a_stall_that_no_depth_should_bridge() -> None:
    assert advice(QoSProfile(5), counters(1800, 1800, 100_000), 190.0) == (
        "the longest stall was 9.5 s, 1800 messages too long for depth 5: find its cause"
    )
    assert advice(QoSProfile(5), counters(1800, 1800, 100_000)) == (
        "the longest stall was 1800 messages too long for depth 5: find its cause"
    )


@for_each(
    ("qos", "statistics"),
    [
        (QoSProfile(5), counters(0, 0)),
        (QoSProfile(5), counters(missed=0)),
        (QoSProfile(5), counters(60, 60, 99)),
        (QoSProfile(history="keep_all"), counters()),
        (QoSProfile(5), EndpointStatistics(expected=100, dropped={"expired": 2}, most_missed=2)),
    ],
)
def test_the_figures_support_none(qos: QoSProfile, statistics: EndpointStatistics) -> None:
    assert advice(qos, statistics, 190.0) == ""
