"""The table of `bus doctor hello`, as ROS 2 prints it."""

from bus_cli.doctor.hello import Summary

TABLE = """\
MULTIMACHINE COMMUNICATION SUMMARY
Topic: /canyouhearme, Published Msg Count: 3
Subscribed from:
                Hostname             Msg Count /1.0s
                far                  2        \x20
Multicast Group/Port: 225.0.0.1/49150, Sent Msg Count: 4
Received from:
                Hostname             Msg Count /1.0s
                a                    1        \x20
                far                  1        \x20
------------------------------------------------------------"""


def test_the_table() -> None:
    summary = Summary("here")
    summary.published, summary.sent = 3, 4
    for text in ("hello, it's me far", "hello, it's me here", "", "far"):
        summary.hear(text, summary.subscribed)
    for text in ("far", "a"):
        summary.hear(text, summary.received)
    assert summary.text("/canyouhearme", 1.0) == TABLE


def test_a_flood_of_names_does_not_grow_without_end() -> None:
    summary = Summary("here")
    for number in range(1100):
        summary.hear(f"host{number}", summary.received)
    summary.hear("host0", summary.received)
    assert len(summary.received) == 1000
    assert summary.received["host0"] == 2
