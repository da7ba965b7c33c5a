"""The columns of `bus top` for topics, nodes and their endpoints, and its sentences. Pure."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from textwrap import wrap
from typing import TypeAlias

from bus.base.counted import counted
from bus.qos import in_words
from bus_cli.output import dropped_text, size_text
from bus_cli.top.figures import (
    NONE,
    SPARK_CELLS,
    bytes_text,
    count_text,
    losses_text,
    rate_text,
    seconds_text,
    spark_text,
)
from bus_cli.top.table import LOSES, LOST, Column, Line, Table
from bus_web.rows import Ages, EndpointRow, NodeRow, Pair, Sums, TopicRow

__all__ = ["BY_NODE", "BY_TOPIC", "SORT_KEYS", "Row", "endpoint_lines", "name_of", "sums_text"]

Row: TypeAlias = TopicRow | NodeRow


def name_of(row: Row) -> str:
    """The topic's or node's full name."""
    return row.topic if isinstance(row, TopicRow) else row.node


def mark_of(row: Row | EndpointRow) -> str:
    return LOSES if row.lost_per_s > 0 else LOST if row.lost else ""


def age_text(ages: Ages | None) -> str:
    return NONE if ages is None else seconds_text(ages.usual)


def p99_text(ages: Ages | None) -> str:
    return NONE if ages is None or ages.p99 is None else seconds_text(ages.p99)


def _p99(ages: Ages | None) -> float:
    return -1.0 if ages is None or ages.p99 is None else ages.p99


def queue_text(row: Row | EndpointRow) -> str:
    if isinstance(row, EndpointRow) and row.kind == "publisher":
        return NONE
    if not isinstance(row, EndpointRow) and not row.subscriptions:
        return NONE
    return str(row.queued) if row.depth is None else f"{count_text(row.queued)}/{count_text(row.depth)}"


def why_text(row: Row | EndpointRow) -> str:
    """A text about the problems of a row."""
    parts = []
    if row.lost_per_s > 0 or row.lost:
        reason = max(row.dropped, key=row.dropped.__getitem__, default="")
        parts.append(f"{'loses now' if row.lost_per_s > 0 else 'has lost'}: {reason}")
    if not isinstance(row, EndpointRow) and row.mismatches:
        number = row.mismatches
        parts.append(f"{number} pair{' does' if number == 1 else 's do'} not match")
    return "; ".join(parts)


def _types_text(row: TopicRow) -> str:
    return ", ".join(name.replace("/msg/", "/") for name in row.types)


def _route_text(row: Row) -> str:
    return row.routes[0] if len(row.routes) == 1 else "mixed" if row.routes else NONE


def _least(number: float | None) -> float:
    return -1.0 if number is None else number


def _columns(title: str, second: Column) -> list[Column]:
    """The columns of topics or nodes. Columns with a width are sorted from the highest value."""
    return [
        Column(title, name_of, lambda row: name_of(row), least=18),
        second,
        Column("HZ", lambda row: rate_text(row.hz), lambda row: _least(row.hz), 7),
        Column("B/S", lambda row: bytes_text(row.bytes_per_s), lambda row: _least(row.bytes_per_s), 9, 5),
        Column("RATE", lambda row: spark_text(row.history), None, SPARK_CELLS, 2),
        Column("PUB", lambda row: count_text(row.publishers), lambda row: row.publishers, 4, 7),
        Column("SUB", lambda row: count_text(row.subscriptions), lambda row: row.subscriptions, 4, 8),
        Column("ROUTE", _route_text, lambda row: row.routes, 6, 3, is_left=True),
        Column("QUEUE", queue_text, lambda row: row.queued, 7, 6),
        Column("AGE", lambda row: age_text(row.age), lambda row: row.age.usual if row.age else -1.0, 7, 4),
        Column("P99", lambda row: p99_text(row.age), lambda row: _p99(row.age), 7, 4),
        Column("LOST/S", lambda row: rate_text(row.lost_per_s), lambda row: row.lost_per_s, 7),
        Column("LOST", lambda row: count_text(row.lost), lambda row: row.lost, 7),
        Column("LOSSES", lambda row: losses_text(row.lost_history), None, SPARK_CELLS, 2),
        Column("WHY", why_text, least=24),
    ]


BY_TOPIC = Table(_columns("TOPIC", Column("TYPE", _types_text, lambda row: row.types, goes=1)), mark_of)
BY_NODE = Table(_columns("NODE", Column("PID", lambda row: str(row.pid), lambda row: row.pid, 8, 1)), mark_of)

SORT_KEYS = BY_TOPIC.sort_keys


def _endpoint_columns(title: str, name: Callable[[EndpointRow], str]) -> list[Column]:
    return [
        Column(title, name, name),
        Column("KIND", lambda row: "pub" if row.kind == "publisher" else "sub", None, 4),
        Column("PID", lambda row: str(row.pid), None, 8, 5),
        Column("MESSAGES", lambda row: count_text(row.messages), None, 9),
        Column("HZ", lambda row: rate_text(row.hz), None, 7, 3),
        Column("QUEUE", queue_text, None, 7, 4),
        Column("AGE", lambda row: age_text(row.age), None, 7, 2),
        Column("P99", lambda row: p99_text(row.age), None, 7, 2),
        Column("LOST", lambda row: NONE if row.kind == "publisher" else dropped_text(row.dropped), least=28),
        Column("LOSSES", lambda row: losses_text(row.lost_history), None, SPARK_CELLS, 1),
        Column("QOS", lambda row: in_words(row.qos), goes=1),
    ]


_OF_TOPIC = Table(_endpoint_columns("NODE", lambda row: row.node), mark_of)
_OF_NODE = Table(_endpoint_columns("TOPIC", lambda row: row.topic), mark_of)


def endpoint_lines(
    row: Row, endpoints: Sequence[EndpointRow], pairs: Iterable[Pair], names: Mapping[int, str], width: int
) -> tuple[str, list[Line]]:
    """The titles, and the lines below them: the endpoints of a row, and each pair that does not match.

    `pairs`: the pairs of the row's topic, or of all topics of its node. `names`: the nodes of the pairs'
    ends.
    """
    table = _OF_TOPIC if isinstance(row, TopicRow) else _OF_NODE
    title, first = table.lines(endpoints, width)
    lines = [*first]
    here = {one.id for one in endpoints}
    for pair in pairs:
        if not pair.route and (pair.publisher in here or pair.subscription in here):
            ends = f"{names.get(pair.publisher, '')} -> {names.get(pair.subscription, '')}"
            text = f"no match: {ends}: {pair.reason}"
            lines += map(Line, wrap(text, max(width, 20), subsequent_indent="  "))
    return title, lines


def sums_text(sums: Sums) -> str:
    """The sums of all rows in a sentence."""
    lost = f"lost {count_text(sums.lost)}" if sums.lost else "nothing lost"
    if sums.lost_per_s > 0:
        lost = f"losing {rate_text(sums.lost_per_s)}/s, {lost}"
    return (
        f"{counted(sums.nodes, 'node')}, {counted(sums.topics, 'topic')}, {rate_text(sums.hz)} messages/s, "
        f"{size_text(sums.bytes_per_s)}/s, {lost}"
    )
