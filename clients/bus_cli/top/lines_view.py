"""A part of the screen with lines of text; the user may choose one. Needs textual."""

from collections.abc import Sequence
from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual import events
from textual.binding import Binding, BindingType
from textual.geometry import Region, Size
from textual.message import Message
from textual.scroll_view import ScrollView
from textual.strip import Strip

from bus.base.printable import printable
from bus_cli.top.table import LOSES, LOST, Line

__all__ = ["LinesView"]

_STYLES = {
    "": Style(),
    LOSES: Style(color="red", bold=True),
    LOST: Style(color="yellow"),
}
_CHOSEN = Style(reverse=True)


class LinesView(ScrollView, can_focus=True):
    """Lines of text; only visible lines are drawn. `chosen` is the index of the chosen line, or -1."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,k", "step(-1)", show=False),
        Binding("down,j", "step(1)", show=False),
        Binding("pageup", "page(-1)", show=False),
        Binding("pagedown", "page(1)", show=False),
        Binding("home", "edge(0)", show=False),
        Binding("end", "edge(1)", show=False),
    ]

    class Chosen(Message):
        """The user has chosen another line."""

        def __init__(self, index: int) -> None:
            super().__init__()
            self.index = index

    def __init__(self, name: str, *, can_choose: bool) -> None:
        super().__init__(id=name)
        self._lines: Sequence[Line] = ()
        self._can_choose = can_choose
        self.chosen = -1

    def show(self, lines: Sequence[Line], chosen: int = -1) -> None:
        """Show other lines. The scroll position only changes if a newly chosen line is out of sight."""
        is_other = chosen != self.chosen
        self._lines, self.chosen = lines, chosen
        size = Size(self._width_of(lines), len(lines))
        if size != self.virtual_size:
            self.virtual_size = size
        if is_other:
            self._bring_in_sight()
        self.refresh()

    def _width_of(self, lines: Sequence[Line]) -> int:
        """Width of all lines. A table fits, so its width is the visible width."""
        return self.size.width if self._can_choose else max((len(line.text) for line in lines), default=0)

    def render_line(self, y: int) -> Strip:
        x, above = self.scroll_offset
        width, index = self.size.width, y + above
        if index >= len(self._lines):
            return Strip.blank(width)
        line = self._lines[index]
        style = _STYLES[line.mark]
        if index == self.chosen:
            style += _CHOSEN
        text = printable(line.text, "")  # texts of other programs may contain escape sequences
        return Strip([Segment(text[x : x + width].ljust(width), style)], width)

    def action_step(self, by: int) -> None:
        if self._can_choose:
            self._choose(self.chosen + by)
        else:
            self.scroll_relative(y=by, animate=False)

    def action_page(self, by: int) -> None:
        self.action_step(by * max(1, self.size.height - 1))

    def action_edge(self, end: int) -> None:
        if self._can_choose:
            self._choose(end * (len(self._lines) - 1))
        else:
            self.scroll_to(y=end * len(self._lines), animate=False)

    def on_click(self, event: events.Click) -> None:
        if self._can_choose:
            self._choose(event.y + self.scroll_offset.y)

    def _choose(self, index: int) -> None:
        index = max(0, min(index, len(self._lines) - 1))
        if self._lines and index != self.chosen:
            self.chosen = index
            self._bring_in_sight()
            self.refresh()
            self.post_message(self.Chosen(index))

    def _bring_in_sight(self) -> None:
        if self.chosen >= 0:
            self.scroll_to_region(Region(0, self.chosen, 1, 1), animate=False, x_axis=False)
