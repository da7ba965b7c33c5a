"""The figures of tf2_monitor, and its output."""

from bus_tf2.programs.tf2_monitor import Counts


def test_counts() -> None:
    counts = Counts()
    assert counts.lines() == ["Frames:", "", "All Broadcasters:"]
    for number in range(11):
        counts.add(10 + number / 10, [("b", 10 + number / 10 - 0.25), ("a", 10 + number / 10 - 0.75)])
    who = "<no authority available>"
    assert counts.lines() == [
        "Frames:",
        f"Frame: a, published by {who}, Average Delay: 0.75, Max Delay: 0.75",
        f"Frame: b, published by {who}, Average Delay: 0.25, Max Delay: 0.25",
        "",
        "All Broadcasters:",
        f"Node: {who} 11 Hz, Average Delay: 0.5, Max Delay: 0.5",
    ]
    assert counts.lines(["b"])[1].startswith("Frame: b,")


def test_a_name_with_escape_sequences() -> None:
    counts = Counts()
    counts.add(1.0, [("\x1b[2Ja\n", 1.0)])
    assert counts.lines()[1].startswith(r"Frame: \x1b[2Ja\n, published")


def test_only_the_last_thousand() -> None:
    counts = Counts()
    for number in range(1500):
        counts.add(number, [("a", 0.0)])
    assert len(counts.delays["a"]) == len(counts.arrivals) == 1000
