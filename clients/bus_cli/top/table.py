"""What `bus top` shows: columns, in which order rows stand, and how they fit a terminal.

Pure: rows of `bus_web.model` come in, lines of text go out.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from textwrap import wrap
from typing import Any, NamedTuple, TypeAlias

from bus.qos import in_words
from bus_cli.output import dropped_text, size_text
from bus_web.model import Ages, EndpointRow, NodeRow, Pair, Sums, TopicRow

__all__ = [
    "BY_NODE",
    "BY_TOPIC",
    "LOSES",
    "LOST",
    "SORT_KEYS",
    "Line",
    "Row",
    "Table",
    "endpoint_lines",
    "name_of",
    "sums_text",
]

Row: TypeAlias = TopicRow | NodeRow

LOSES, LOST = "loses", "lost"
"""How a line is marked: what it shows loses messages now, or has lost some."""

_NONE = "-"
_SPARKS = "▁▂▃▄▅▆▇█"
_SPARK_CELLS = 10
_NARROWEST = 4
_HEADROOM = 1.5
"""A rate that never changes is drawn at two thirds of the height, so that both ways are left to go."""


class Line(NamedTuple):
    text: str
    mark: str = ""
    """LOSES, LOST or nothing."""


class Column(NamedTuple):
    title: str
    text: Callable[[Any], str]
    key: Callable[[Any], Any] | None = None
    """By what rows are sorted, numbers from the highest, texts from a; None where they can't be."""
    width: int = 0
    """In cells; 0: as wide as the longest text, where there is room."""
    goes: int = 0
    """Where the terminal is too narrow: 1 goes first; 0 stays."""


def name_of(row: Row) -> str:
    """The topic's or node's full name."""
    return row.topic if isinstance(row, TopicRow) else row.node


class Table:
    """`columns` of rows, in the order of one of them."""

    def __init__(self, columns: Sequence[Column], least: int) -> None:
        self.columns = columns
        self._least = least
        """Cells of a column without a width, at least."""

    @property
    def sort_keys(self) -> list[str]:
        return [column.title.lower() for column in self.columns if column.key is not None]

    def sort(self, rows: Iterable[Any], by: str, *, reverse: bool = False) -> list[Any]:
        """Sorted by a key of `sort_keys`; what is equal there is sorted by the first column."""
        first, *_ = self.columns
        found = next((one for one in self.columns if one.title.lower() == by and one.key), first)
        assert first.key is not None
        assert found.key is not None
        ordered = sorted(rows, key=first.key)
        falls = found.width != 0
        return sorted(ordered, key=found.key, reverse=falls is not reverse)

    def lines(self, rows: Sequence[Any], width: int | None, *, by: str = "") -> "tuple[str, Lines]":
        """The titles, that of the column `by` in brackets, and a line for each row, within `width` cells.

        Without a width all columns are there and as wide as they would be.
        """
        columns = [*self.columns]
        wanted = {
            one.title: one.width or max(len(one.title) + 2, max(map(len, map(one.text, rows)), default=0))
            for one in columns
        }
        widths = wanted if width is None else _fit(columns, wanted, width, self._least)
        shown = [(one, widths[one.title]) for one in columns if one.title in widths]
        titles = [
            _cell(f"[{one.title}]" if one.title.lower() == by else one.title, cells, one)
            for one, cells in shown
        ]
        return " ".join(titles).rstrip(), Lines(rows, shown)


class Lines(Sequence[Line]):
    """A line for each of `rows`, written when it is asked for: of a thousand rows, forty are in sight."""

    def __init__(self, rows: Sequence[Any], columns: Sequence[tuple[Column, int]]) -> None:
        self._rows = rows
        self._columns = columns

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[one] for one in range(*index.indices(len(self)))]
        row = self._rows[index]
        cells = [_cell(column.text(row), width, column) for column, width in self._columns]
        return Line(" ".join(cells).rstrip(), mark_of(row))


def _fit(columns: list[Column], wanted: Mapping[str, int], width: int, least: int) -> dict[str, int]:
    """How wide each column that is shown is."""
    here = [*columns]
    while True:
        widths = {one.title: one.width or min(wanted[one.title], least) for one in here}
        left = width - sum(widths.values()) - (len(here) - 1)
        going = [one for one in here if one.goes]
        if left >= 0 or not going:
            break
        here.remove(min(going, key=lambda one: one.goes))
    narrow = {one.title for one in here if one.width == 0}
    while left < 0 and (title := max(narrow, key=lambda title: (widths[title], title), default="")):
        if widths[title] <= _NARROWEST:
            break
        widths[title] -= 1
        left += 1
    for one in sorted(here, key=lambda one: one.goes):
        if one.width == 0 and left > 0:
            more = min(left, wanted[one.title] - widths[one.title])
            widths[one.title] += more
            left -= more
    return widths


def _cell(text: str, width: int, column: Column) -> str:
    if len(text) > width:
        text = f"{text[: max(width - 1, 0)]}…" if width else ""
    return text.rjust(width) if column.width and column.title != "ROUTE" else text.ljust(width)


def mark_of(row: Row | EndpointRow) -> str:
    return LOSES if row.lost_per_s > 0 else LOST if row.lost else ""


# --- cells


def rate_text(rate: float | None) -> str:
    """`29.9`; `-` where it is not known."""
    if rate is None:
        return _NONE
    if rate >= 1e6:
        return count_text(int(rate))
    return (
        f"{rate:.0f}" if rate >= 1000 or rate == int(rate) else f"{rate:.1f}" if rate >= 10 else f"{rate:.2f}"
    )


def count_text(count: int) -> str:
    """At most seven characters."""
    for size, unit in ((10**12, "T"), (10**9, "G"), (10**6, "M")):
        if count >= size:
            return f"{count / size:.2f}{unit}" if count < 1000 * size else f"{count // size}{unit}"
    return str(count)


def bytes_text(rate: float | None) -> str:
    return _NONE if rate is None else size_text(rate)


def seconds_text(seconds: float) -> str:
    """A time in the unit that fits, in at most seven characters: `12.3 ms`."""
    for size, unit in ((1.0, "s"), (1e-3, "ms")):
        if seconds >= size:
            return _short(seconds / size, unit)
    return _short(seconds * 1e6, "µs")


def _short(value: float, unit: str) -> str:
    return f"{value:.0f} {unit}" if value >= 100 else f"{value:.1f} {unit}"


def age_text(ages: Ages | None) -> str:
    return _NONE if ages is None else seconds_text(ages.mean)


def queue_text(row: Row | EndpointRow) -> str:
    if isinstance(row, EndpointRow) and row.kind == "publisher":
        return _NONE
    if not isinstance(row, EndpointRow) and not row.subscriptions:
        return _NONE
    return str(row.queued) if row.depth is None else f"{count_text(row.queued)}/{count_text(row.depth)}"


def spark_text(history: Sequence[float], cells: int = _SPARK_CELLS) -> str:
    """The last seconds as bars."""
    shown = history[-cells:]
    top = _HEADROOM * max(shown, default=0.0)
    if not top:
        return ("▁" * len(shown)).rjust(cells)
    # What is not nothing is more than the lowest.
    bars = (_SPARKS[max(1, round(one / top * (len(_SPARKS) - 1)))] if one else "▁" for one in shown)
    return "".join(bars).rjust(cells)


def why_text(row: Row | EndpointRow) -> str:
    """What is wrong, in words."""
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
    return row.routes[0] if len(row.routes) == 1 else "mixed" if row.routes else _NONE


def _least(number: float | None) -> float:
    return -1.0 if number is None else number


def _columns(title: str, second: Column) -> list[Column]:
    """Columns are sorted from the highest where they have a width."""
    return [
        Column(title, name_of, lambda row: name_of(row)),
        second,
        Column("HZ", lambda row: rate_text(row.hz), lambda row: _least(row.hz), 7),
        Column("B/S", lambda row: bytes_text(row.bytes_per_s), lambda row: _least(row.bytes_per_s), 9, 5),
        Column("RATE", lambda row: spark_text(row.history), None, _SPARK_CELLS, 2),
        Column("PUB", lambda row: count_text(row.publishers), lambda row: row.publishers, 4, 7),
        Column("SUB", lambda row: count_text(row.subscriptions), lambda row: row.subscriptions, 4, 8),
        Column("ROUTE", _route_text, lambda row: row.routes, 6, 3),
        Column("QUEUE", queue_text, lambda row: row.queued, 7, 6),
        Column("AGE", lambda row: age_text(row.age), lambda row: row.age.mean if row.age else -1.0, 7, 4),
        Column("LOST/S", lambda row: rate_text(row.lost_per_s), lambda row: row.lost_per_s, 7),
        Column("LOST", lambda row: count_text(row.lost), lambda row: row.lost, 7),
        Column("WHY", why_text),
    ]


BY_TOPIC = Table(_columns("TOPIC", Column("TYPE", _types_text, lambda row: row.types, goes=1)), 16)
BY_NODE = Table(_columns("NODE", Column("PID", lambda row: str(row.pid), lambda row: row.pid, 8, 1)), 16)

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
        Column("LOST", lambda row: _NONE if row.kind == "publisher" else dropped_text(row.dropped)),
        Column("QOS", lambda row: in_words(row.qos), goes=1),
    ]


_OF_TOPIC = Table(_endpoint_columns("NODE", lambda row: row.node), 16)
_OF_NODE = Table(_endpoint_columns("TOPIC", lambda row: row.topic), 16)


def endpoint_lines(
    row: Row, endpoints: Sequence[EndpointRow], pairs: Iterable[Pair], names: Mapping[int, str], width: int
) -> tuple[str, list[Line]]:
    """The titles, and the lines below them: the endpoints of a row, and each pair that does not match.

    `pairs`: those of the row's topic, or of all topics of its node; `names`: the nodes of their ends.
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
    """All together, in a sentence."""
    lost = f"lost {count_text(sums.lost)}" if sums.lost else "nothing lost"
    if sums.lost_per_s > 0:
        lost = f"losing {rate_text(sums.lost_per_s)}/s, {lost}"
    return (
        f"{_some(sums.nodes, 'node')}, {_some(sums.topics, 'topic')}, {rate_text(sums.hz)} messages/s, "
        f"{size_text(sums.bytes_per_s)}/s, {lost}"
    )


def _some(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
