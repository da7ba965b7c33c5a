"""Columns, cells and the order of rows of `bus top`."""

from typing import Any

from msgspec.structs import replace

from bus.qos import QoSProfile
from bus_cli.top.columns import (
    BY_NODE,
    BY_TOPIC,
    SORT_KEYS,
    age_text,
    endpoint_lines,
    mark_of,
    p99_text,
    queue_text,
    sums_text,
    why_text,
)
from bus_cli.top.table import LOSES, LOST
from bus_web.rows import Ages, EndpointRow, NodeRow, Pair, Sums, TopicRow
from rows import for_each

QUIET: dict[str, Any] = {
    "hz": None,
    "bytes_per_s": None,
    "history": (),
    "publishers": 1,
    "subscriptions": 0,
    "routes": (),
    "queued": 0,
    "depth": None,
    "age": None,
    "lost_per_s": 0.0,
    "dropped": {},
    "lost_history": (),
    "lost_in_all": 0,
    "mismatches": 0,
}


def topic(
    name: str = "/scan", types: tuple[str, ...] = ("sensor_msgs/msg/LaserScan",), **others: Any
) -> TopicRow:
    return TopicRow(topic=name, types=types, **{**QUIET, **others})


def endpoint(number: int, kind: str, node: str, **others: Any) -> EndpointRow:
    given = {
        "bytes": 0, "bytes_per_s": None, "hz": None, "messages": 0, "queued": 0, "depth": 10, "dropped": {},
        "lost_per_s": 0.0, "routes": (), "age": None, "qos": QoSProfile(), **others,
    }  # fmt: skip
    return EndpointRow(
        id=number, kind=kind, topic="/scan", node=node, node_id=1, pid=7, type_name="a/msg/B", **given
    )


BUSY = topic(
    hz=29.94,
    bytes_per_s=1500.0,
    history=(30.0,) * 12,
    subscriptions=2,
    routes=("shm",),
    queued=3,
    depth=10,
    age=Ages(0.0012, 0.01),
    lost_per_s=2.0,
    dropped={"replaced": 12, "expired": 1},
)


def test_a_row() -> None:
    title, lines = BY_TOPIC.lines([BUSY], None, by="hz")
    assert title.split() == [
        "TOPIC", "TYPE", "[HZ]", "B/S", "RATE", "PUB", "SUB", "ROUTE", "QUEUE", "AGE", "P99", "LOST/S",
        "LOST", "LOSSES", "WHY",
    ]  # fmt: skip
    text, mark = lines[0]
    assert text.split() == [
        "/scan", "sensor_msgs/LaserScan", "29.9", "1.50", "KB", "▆▆▆▆▆▆▆▆▆▆", "1", "2", "shm", "3/10",
        "1.2", "ms", "-", "2", "13", "loses", "now:", "replaced",
    ]  # fmt: skip
    assert mark == LOSES
    assert lines[0:1] == [*lines]


def test_ages() -> None:
    old, new = Ages(0.5, 2.0), Ages(0.5, 2.0, p50=0.0021, p99=0.013)
    assert [(age_text(one), p99_text(one)) for one in (None, old, new)] == [
        ("-", "-"),
        ("500 ms", "-"),
        ("2.1 ms", "13.0 ms"),
    ]
    rows = [topic("/a"), topic("/b", age=new), topic("/c", age=old)]
    assert [row.topic for row in BY_TOPIC.sort(rows, "age")] == ["/c", "/b", "/a"]
    assert [row.topic for row in BY_TOPIC.sort(rows, "p99")] == ["/b", "/a", "/c"]


def test_losses_of_the_last_minute_are_bars() -> None:
    quiet, losing = topic("/quiet"), topic("/scan", lost_history=(0.0,) * 48 + (1.0,) * 6 + (4.0,) * 6)
    _, lines = BY_TOPIC.lines([quiet, losing], None)
    assert "▁▁▁▁▁▁▁▁▃█" in lines[1].text
    assert "▁" not in lines[0].text.partition("/quiet")[2].strip("▁ ")


@for_each("width", [40, 60, 80, 100, 120, 160, 250])
def test_no_line_is_wider_than_the_terminal(width: int) -> None:
    rows = [topic(f"/robot/arm/joint_{'x' * number}", hz=1e9, mismatches=number) for number in range(40)]
    title, lines = BY_TOPIC.lines([BUSY, *rows], width, by="lost/s")
    assert all(len(text) <= width for text in (title, *(line.text for line in lines)))
    for name in ("TOPIC", "HZ", "LOST", "WHY"):
        assert name in title
    assert (len(title.split()) == 15) == (width >= 160)


def test_reasons_come_before_bars() -> None:
    busy = replace(BUSY, topic="/camera/image_raw")
    title, (line,) = BY_TOPIC.lines([busy], 120)
    assert "RATE" not in title
    assert line.text.startswith("/camera/image_raw ")
    assert line.text.endswith(" loses now: replaced")
    title, _ = BY_TOPIC.lines([topic()], 130)
    assert "RATE" in title, "without reasons there is room"


def test_80_columns_say_who_loses_what_and_why() -> None:
    title, (line,) = BY_TOPIC.lines([BUSY], 80)
    assert title.split() == ["TOPIC", "HZ", "B/S", "PUB", "SUB", "QUEUE", "LOST/S", "LOST", "WHY"]
    assert "loses now: replaced" in line.text


@for_each(
    ("by", "names"),
    [
        ("topic", "abc"),
        ("hz", "bca"),
        ("lost", "acb"),
        ("type", "bac"),
        ("unknown", "abc"),
    ],
)
def test_order(by: str, names: str) -> None:
    rows = [
        topic("c", ("x/msg/C",), hz=1.0, dropped={"replaced": 1}),
        topic("b", ("x/msg/A",), hz=10.0),
        topic("a", ("x/msg/B",), hz=None, dropped={"replaced": 3}),
    ]
    assert "".join(row.topic for row in BY_TOPIC.sort(rows, by)) == names
    backwards = BY_TOPIC.sort(rows, by, reverse=True)
    assert "".join(row.topic for row in backwards) == names[::-1]


def test_what_is_equal_stands_by_name() -> None:
    rows = [topic(name, lost_per_s=1.0) for name in "cab"]
    assert "".join(row.topic for row in BY_TOPIC.sort(rows, "lost/s")) == "abc"


def test_every_key_sorts_every_row() -> None:
    node = NodeRow(node="/talker", id=1, pid=7, **QUIET)
    assert BY_TOPIC.sort_keys == SORT_KEYS
    for by in SORT_KEYS:
        assert len(BY_TOPIC.sort([topic(), BUSY], by)) == 2
    for by in BY_NODE.sort_keys:
        assert BY_NODE.sort([node], by) == [node]
    assert BY_NODE.lines([node], None)[1][0].text.split()[:2] == ["/talker", "7"]


@for_each(
    ("row", "text"),
    [
        (topic(), "-"),
        (topic(subscriptions=1, queued=4, depth=None), "4"),
        (topic(subscriptions=1, queued=4, depth=1000), "4/1000"),
        (endpoint(1, "publisher", "/a"), "-"),
        (endpoint(1, "subscription", "/a", queued=2), "2/10"),
    ],
)
def test_queues(row: TopicRow | EndpointRow, text: str) -> None:
    assert queue_text(row) == text


@for_each(
    ("row", "why", "mark"),
    [
        (topic(), "", ""),
        (BUSY, "loses now: replaced", LOSES),
        (replace(BUSY, lost_per_s=0.0), "has lost: replaced", LOST),
        (topic(mismatches=1), "1 pair does not match", ""),
        (replace(BUSY, mismatches=2), "loses now: replaced; 2 pairs do not match", LOSES),
        (endpoint(1, "subscription", "/a", dropped={"expired": 1}), "has lost: expired", LOST),
    ],
)
def test_losses_are_said_in_words(row: TopicRow | EndpointRow, why: str, mark: str) -> None:
    assert (why_text(row), mark_of(row)) == (why, mark)


def test_endpoints_and_what_does_not_match() -> None:
    talker, listener = (
        endpoint(1, "publisher", "/talker", hz=10.0, messages=40),
        endpoint(
            2,
            "subscription",
            "/listener",
            dropped={"replaced": 2, "expired": 1},
            lost_per_s=1.0,
            lost_history=(0.0,) * 54 + (0.5,) * 6,
        ),
    )
    pairs = [Pair(1, 2, "shm"), Pair(1, 3, reason="ERROR: one is best effort, the other is not"), Pair(8, 9)]
    names = {1: "/talker", 2: "/listener", 3: "/other"}
    title, lines = endpoint_lines(BUSY, [talker, listener], pairs, names, 120)
    assert title.split() == ["NODE", "KIND", "PID", "MESSAGES", "HZ", "QUEUE", "AGE", "P99", "LOST", "QOS"]
    first, second, third = lines
    wide, (_, losing, _) = endpoint_lines(BUSY, [talker, listener], pairs, names, 140)
    assert wide.split()[-3:] == ["LOST", "LOSSES", "QOS"]
    assert "3 (expired: 1, replaced: 2) ▁▁▁▁▁▁▁▁▁█ keep last" in losing.text
    assert first.text.split()[:6] == ["/talker", "pub", "7", "40", "10", "-"]
    assert "3 (expired: 1, replaced: 2)" in second.text
    assert (first.mark, second.mark) == ("", LOSES)
    assert third.text == "no match: /talker -> /other: ERROR: one is best effort, the other is not"
    _, lines = endpoint_lines(BUSY, [talker, listener], pairs, names, 40)
    assert all(len(line.text) <= 40 for line in lines)
    assert " ".join("".join(line.text for line in lines[2:]).split()) == " ".join(third.text.split())
    of_node, _ = endpoint_lines(NodeRow(node="/talker", id=1, pid=7, **QUIET), [talker], [], names, 120)
    assert of_node.startswith("TOPIC")


def test_sums() -> None:
    quiet = Sums(nodes=1, topics=2, hz=0.0, bytes_per_s=0.0, lost_per_s=0.0, lost=0)
    assert sums_text(quiet) == "1 node, 2 topics, 0 messages/s, 0 B/s, nothing lost"
    busy = Sums(nodes=2, topics=1, hz=12.5, bytes_per_s=2e6, lost_per_s=3.0, lost=12)
    assert sums_text(busy) == "2 nodes, 1 topic, 12.5 messages/s, 2.00 MB/s, losing 3/s, lost 12"
