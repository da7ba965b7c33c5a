"""The current view of `bus top`: the column to sort by, the rows, and the chosen row. Pure."""

from collections.abc import Sequence

from bus_cli.top.columns import BY_NODE, BY_TOPIC, Row, name_of, sums_text
from bus_cli.top.table import Table
from bus_web.model import Model
from bus_web.rows import EndpointRow, NodeRow, Pair, TopicRow

__all__ = ["State"]


class State:
    """`by`: the key that rows are sorted by; `hidden`: whether hidden topics and nodes are shown."""

    def __init__(self, by: str = "topic", *, hidden: bool = False) -> None:
        self.by = by
        self.table: Table = BY_TOPIC
        """The columns of topics, or of nodes."""
        self.filter = ""
        self.is_paused = False
        self.is_away = False
        """Whether busd does not answer."""
        self.rows: Sequence[Row] = ()
        self.index = -1
        """The index of the chosen row; -1 if there is none."""
        self.sums = "looking for the bus"
        self._hidden = hidden
        self._is_reversed = False
        self._model: Model | None = None
        self._name = ""
        """Name of the row that the user chose; the row may be absent at the moment."""

    @property
    def chosen(self) -> Row | None:
        return self.rows[self.index] if self.rows else None

    @property
    def endpoints(self) -> list[EndpointRow]:
        """Endpoints of the chosen row."""
        if self._model is None or (row := self.chosen) is None:
            return []
        if isinstance(row, NodeRow):
            return self._model.endpoints_of_node(row.id)
        return self._model.endpoints(row.topic)

    @property
    def pairs(self) -> list[Pair]:
        """Pairs on the topics of the chosen row's endpoints."""
        if self._model is None:
            return []
        topics = dict.fromkeys(one.topic for one in self.endpoints)
        return [pair for topic in topics for pair in self._model.pairs(topic)]

    @property
    def names(self) -> dict[int, str]:
        """The nodes of the ends of `pairs`."""
        if self._model is None:
            return {}
        topics = dict.fromkeys(one.topic for one in self.endpoints)
        return {one.id: one.node for topic in topics for one in self._model.endpoints(topic)}

    @property
    def about(self) -> str:
        """The title above the endpoints of the chosen row."""
        row = self.chosen
        if row is None:
            return ""
        if isinstance(row, TopicRow):
            return f"{row.topic}  {', '.join(row.types)}"
        return f"{row.node}  process {row.pid}"

    @property
    def notes(self) -> list[str]:
        """Notes for the user about the view."""
        notes = []
        if self.is_away:
            notes.append("busd does not answer; these are the last figures")
        if self.is_paused:
            notes.append("paused")
        if self.filter:
            notes.append(f"only with {self.filter!r}")
        if self._hidden:
            notes.append("hidden ones too")
        if self._is_reversed:
            notes.append("reversed")
        return notes

    def take(self, model: Model) -> None:
        """Show a new model of the bus."""
        self._model = model
        self._arrange()

    def choose(self, index: int) -> None:
        self.index, self._name = index, name_of(self.rows[index])

    def sort_by_next(self) -> None:
        keys = self.table.sort_keys
        at = keys.index(self.by) if self.by in keys else -1
        self.by = keys[(at + 1) % len(keys)]
        self._is_reversed = False
        self._arrange()

    def reverse(self) -> None:
        self._is_reversed = not self._is_reversed
        self._arrange()

    def toggle_hidden(self) -> None:
        self._hidden = not self._hidden
        self._arrange()

    def toggle_nodes(self) -> None:
        self.table = BY_NODE if self.table is BY_TOPIC else BY_TOPIC
        self._name, self.index = "", 0
        if self.by not in (keys := self.table.sort_keys):
            self.by = keys[0]
        self._arrange()

    def set_filter(self, text: str) -> None:
        """Only show rows with `text` in their name, type or process; ignores case."""
        self.filter = text
        self._arrange()

    def _arrange(self) -> None:
        model = self._model
        if model is None:
            return
        topics = model.topics(hidden=self._hidden)
        rows: Sequence[Row] = model.nodes(hidden=self._hidden) if self.table is BY_NODE else topics
        if text := self.filter.lower():
            rows = [row for row in rows if text in _searched(row)]
        self.rows = self.table.sort(rows, self.by, reverse=self._is_reversed)
        self.sums = sums_text(model.sums(topics))
        places = (place for place, row in enumerate(self.rows) if name_of(row) == self._name)
        self.index = next(places, min(max(self.index, 0), len(self.rows) - 1))


def _searched(row: Row) -> str:
    others = row.types if isinstance(row, TopicRow) else (str(row.pid),)
    return " ".join((name_of(row), *others)).lower()
