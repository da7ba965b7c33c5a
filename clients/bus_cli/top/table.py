"""Rows as lines of text: sorted by a column, and fitted to the width of a terminal. Pure."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

__all__ = ["LOSES", "LOST", "Column", "Line", "Lines", "Table"]

LOSES, LOST = "loses", "lost"
"""Marks of a line: its subject loses messages now, or has lost some."""

_NARROWEST = 4


class Line(NamedTuple):
    text: str
    mark: str = ""
    """LOSES, LOST or ""."""


class Column(NamedTuple):
    title: str
    text: Callable[[Any], str]
    key: Callable[[Any], Any] | None = None
    """Key to sort rows by: numbers from the highest, texts from a; None: this column can't sort rows."""
    width: int = 0
    """Width in cells; 0: as wide as the longest text, if there is room."""
    goes: int = 0
    """Order of removal if the terminal is too narrow: 1 goes first; 0 stays."""
    is_left: bool = False
    """Whether texts are aligned left although there is a width."""
    least: int = 16
    """For a column without a width: columns that may go are removed until its texts have this many cells."""


class Table:
    """Rows with `columns`, sorted by one of them."""

    def __init__(self, columns: Sequence[Column], mark: Callable[[Any], str]) -> None:
        self.columns = columns
        self._mark = mark

    @property
    def sort_keys(self) -> list[str]:
        return [column.title.lower() for column in self.columns if column.key is not None]

    def sort(self, rows: Iterable[Any], by: str, *, reverse: bool = False) -> list[Any]:
        """Sort by a key of `sort_keys`; equal rows are sorted by the first column."""
        first, *_ = self.columns
        found = next((one for one in self.columns if one.title.lower() == by and one.key), first)
        assert first.key is not None
        assert found.key is not None
        ordered = sorted(rows, key=first.key)
        falls = found.width != 0
        return sorted(ordered, key=found.key, reverse=falls is not reverse)

    def lines(self, rows: Sequence[Any], width: int | None, *, by: str = "") -> "tuple[str, Lines]":
        """The titles and a line for each row, within `width` cells.

        The title of the column `by` has brackets. Without a `width`, all columns are present and as wide as
        they need.
        """
        columns = [*self.columns]
        wanted = {
            one.title: one.width or max(len(one.title) + 2, max(map(len, map(one.text, rows)), default=0))
            for one in columns
        }
        widths = wanted if width is None else _fit(columns, wanted, width)
        shown = [(one, widths[one.title]) for one in columns if one.title in widths]
        titles = [
            _cell(f"[{one.title}]" if one.title.lower() == by else one.title, cells, one)
            for one, cells in shown
        ]
        return " ".join(titles).rstrip(), Lines(rows, shown, self._mark)


class Lines(Sequence[Line]):
    """A line for each of `rows`, made on access: of a thousand rows, only about forty are visible."""

    def __init__(
        self, rows: Sequence[Any], columns: Sequence[tuple[Column, int]], mark: Callable[[Any], str]
    ) -> None:
        self._rows = rows
        self._columns = columns
        self._mark = mark

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[one] for one in range(*index.indices(len(self)))]
        row = self._rows[index]
        cells = [_cell(column.text(row), width, column) for column, width in self._columns]
        return Line(" ".join(cells).rstrip(), self._mark(row))


def _fit(columns: list[Column], wanted: Mapping[str, int], width: int) -> dict[str, int]:
    """The width of each column that fits."""
    here = [*columns]
    while True:
        widths = {one.title: one.width or min(wanted[one.title], one.least) for one in here}
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
    return text.rjust(width) if column.width and not column.is_left else text.ljust(width)
