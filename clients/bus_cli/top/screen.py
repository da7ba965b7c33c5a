"""`bus top` on a terminal: the table, details of the chosen row below it, and keys. Needs textual."""

import asyncio
import os
from argparse import Namespace
from codecs import getincrementaldecoder
from collections.abc import Coroutine
from contextlib import suppress
from functools import partial
from time import monotonic, monotonic_ns
from typing import ClassVar

from textual import events
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.drivers import linux_driver
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from bus.errors import BusError
from bus.graph import Graph
from bus.node import Node
from bus_cli.output import CommandError
from bus_cli.stream import open_node, run_stream
from bus_cli.top.ascii_text import ascii_text, is_ascii_only
from bus_cli.top.columns import endpoint_lines, name_of
from bus_cli.top.lines_view import LinesView
from bus_cli.top.state import State
from bus_cli.top.table import Line
from bus_cli.top.values import Values
from bus_web.descriptions import Descriptions
from bus_web.model import Model
from bus_web.rows import TopicRow

__all__ = ["Top", "run"]

_NEWS_S = 0.1
_SILENT_S = 3.0
_HELP = """\
up, down, PgUp, PgDn   choose a row (j and k, too); Home, End
s          sort by the next column; its title is in [brackets]
r          reverse the order
/          only rows with this text in a name or type; Escape: all again
h          also hidden topics and nodes
n          nodes instead of topics
Enter      the topic's messages, like `bus topic echo`; again: endpoints
Tab        scroll the lower half
space      pause the display
q, Ctrl-C  quit

A row is red while messages are lost, and yellow if some were lost before.
WHY has the reason; the lower half shows endpoints that do not match.
docs/look.md explains the columns. Any key closes this."""
_SHORT_HELP = """\
up down j k PgUp PgDn  choose a row
s sort by next column  r reverse
/ only rows with a text  Escape: all
h hidden ones, too     n by node
Enter values or endpoints
Tab scroll the lower half
space pause            q Ctrl-C quit
Any key closes this."""
"""It fits a terminal of 40 columns and 10 lines."""
_FRAME = 4, 2
"""Columns and lines around a help text."""
_KEYS = "s sort  r reverse  / filter  h hidden  n nodes  Enter values  space pause  ? help  q quit"


# textual's thread for keys would end at bytes that are not UTF-8, for example of an old mouse protocol.
vars(linux_driver)["getincrementaldecoder"] = lambda name: partial(getincrementaldecoder(name), "replace")


def run(args: Namespace) -> int:
    """Run until `q`. Raises KeyboardInterrupt at Ctrl-C; CommandError or BusError without busd."""
    return run_stream(_run(args))


async def _run(args: Namespace) -> int:
    async with open_node(args) as node:
        top = Top(node, args.delay, State(args.sort, hidden=args.include_hidden_topics))
        await top.run_async()
        if (task := asyncio.current_task()) is not None and task.cancelling():
            raise asyncio.CancelledError  # a signal; textual handles it like `q`
    if top.failure is not None:
        raise top.failure
    return 0


class Help(ModalScreen[None]):
    """The list of keys."""

    def compose(self) -> ComposeResult:
        with VerticalScroll(id="help"):
            size, lines = self.app.size, _HELP.splitlines()
            wide, high = max(map(len, lines)) + _FRAME[0], len(lines) + _FRAME[1]
            fits = wide <= size.width and high <= size.height
            yield Static(_HELP if fits else _SHORT_HELP, markup=False)

    def on_key(self, event: events.Key) -> None:
        event.stop()
        self.dismiss()

    def on_click(self) -> None:
        self.dismiss()


class _AsciiDriver(linux_driver.LinuxDriver):
    """Writes ASCII only."""

    def write(self, data: str) -> None:
        super().write(ascii_text(data))


class Top(App[None]):
    """Shows the bus of `node`, updated every `delay_s` seconds. `failure`: the error that ended it."""

    ENABLE_COMMAND_PALETTE = False
    CSS = """
    Screen { background: ansi_default; color: ansi_default; }
    Static, LinesView, Input { background: ansi_default; color: ansi_default; }
    Static { height: 1; }
    #titles, #below_titles { text-style: bold underline; }
    #rows { height: 3fr; scrollbar-size: 1 1; overflow-x: hidden; }
    #below { height: 2fr; scrollbar-size: 1 1; }
    #filter { height: 1; border: none; padding: 0; display: none; }
    Help { align: center middle; background: ansi_default; }
    #help { width: auto; max-width: 100%; height: auto; max-height: 100%; border: round; padding: 0 1; }
    #help Static { width: auto; height: auto; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("q", "quit", show=False),
        Binding("ctrl+c", "interrupt", show=False, priority=True),
        Binding("ctrl+z", "suspend_process", show=False),
        Binding("s", "sort", show=False),
        Binding("r", "reverse", show=False),
        Binding("slash", "filter", show=False),
        Binding("h", "hidden", show=False),
        Binding("n", "by_node", show=False),
        Binding("space", "pause", show=False),
        Binding("enter", "values", show=False),
        Binding("escape", "leave", show=False),
        Binding("question_mark", "help", show=False),
    ]

    def __init__(self, node: Node, delay_s: float, state: State) -> None:
        super().__init__(_AsciiDriver if is_ascii_only(os.environ) else None, ansi_color=True)
        self.failure: BaseException | None = None
        self._node = node
        self._delay_s = delay_s
        self._state = state
        self._descriptions = Descriptions(node)
        self._model = Model({os.getpid()}, self._descriptions)
        self._values: Values | None = None
        self._looked_s = monotonic()
        self._tasks: set[asyncio.Task[None]] = set()

    def compose(self) -> ComposeResult:
        yield Static(id="sums", markup=False)
        yield Static(id="titles", markup=False)
        yield LinesView("rows", can_choose=True)
        yield Static(id="about", markup=False)
        yield Static(id="below_titles", markup=False)
        yield LinesView("below", can_choose=False)
        yield Input(id="filter", placeholder="text in a name or type", compact=True)
        yield Static(_KEYS, id="keys", markup=False)

    def on_mount(self) -> None:
        self.query_one("#rows").focus()
        self._start(self._poll_forever())
        self.set_interval(_NEWS_S, self._show_news)

    def on_resize(self) -> None:
        self.call_after_refresh(self._show)

    # --- looking

    def _start(self, work: Coroutine[object, object, None]) -> None:
        task = asyncio.get_running_loop().create_task(self._guard(work))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _guard(self, work: Coroutine[object, object, None]) -> None:
        try:
            await work
        except (BusError, CommandError, TimeoutError) as error:
            self.failure = error
            self.exit()

    async def _poll_forever(self) -> None:
        while True:
            began_s = monotonic()
            if not self._state.is_paused:
                with suppress(TimeoutError):  # _show_news reports it in the sums
                    self._take(await self._node.graph(statistics=True))
                    if await self._descriptions.ask():
                        self._model.forget_pairs()
            await asyncio.sleep(max(0.02, began_s + self._delay_s - monotonic()))

    def _take(self, graph: Graph) -> None:
        self._looked_s = monotonic()
        self._state.is_away = False
        self._model.take(graph, monotonic_ns())
        self._state.take(self._model)
        self._show()

    # --- showing

    def _show(self) -> None:
        if not self.is_running or not self.query("#rows"):
            return
        state, rows = self._state, self.query_one("#rows", LinesView)
        width = rows.size.width - 1  # the scrollbar must not cover the last column
        title, lines = state.table.lines(state.rows, width, by=state.by)
        self.query_one("#titles", Static).update(title)
        rows.show(lines, state.index)
        self._show_status()
        self._show_below()

    def _show_status(self) -> None:
        self.query_one("#sums", Static).update("; ".join((self._state.sums, *self._state.notes)))

    def _show_below(self) -> None:
        chosen, below = self._state.chosen, self.query_one("#below", LinesView)
        if self._values is not None:
            return
        title, about = "", ""
        lines: list[Line] = []
        if chosen is not None:
            state, width = self._state, below.size.width - 1
            title, lines = endpoint_lines(chosen, state.endpoints, state.pairs, state.names, width)
            about = state.about
        self.query_one("#about", Static).update(about)
        self.query_one("#below_titles", Static).update(title)
        below.show(lines)

    def _show_news(self) -> None:
        """Show changes between two looks: new values, and a busd that does not answer."""
        is_silent = monotonic() - self._looked_s > self._delay_s + _SILENT_S
        is_away = (is_silent or not self._node.is_connected) and not self._state.is_paused
        if is_away != self._state.is_away:
            self._state.is_away = is_away
            self._show_status()
        if (values := self._values) is not None and values.has_news:
            self.query_one("#about", Static).update(values.about)
            self.query_one("#below_titles", Static).update("")
            self.query_one("#below", LinesView).show(values.lines())

    # --- keys

    def on_lines_view_chosen(self, event: LinesView.Chosen) -> None:
        self._state.choose(event.index)
        self._end_values()
        self._show()

    def action_interrupt(self) -> None:
        self.failure = KeyboardInterrupt()
        self.exit()

    def action_sort(self) -> None:
        self._state.sort_by_next()
        self._show()

    def action_reverse(self) -> None:
        self._state.reverse()
        self._show()

    def action_hidden(self) -> None:
        self._state.toggle_hidden()
        self._show()

    def action_by_node(self) -> None:
        self._end_values()
        self._state.toggle_nodes()
        self._show()

    def action_pause(self) -> None:
        self._state.is_paused = not self._state.is_paused
        self._looked_s = monotonic()
        self._show_status()

    def action_help(self) -> None:
        self.push_screen(Help())

    def action_filter(self) -> None:
        line = self.query_one("#filter", Input)
        line.display = True
        line.value = self._state.filter
        line.focus()

    def action_leave(self) -> None:
        """Handle Escape: leave the mode that was entered last."""
        if self.query_one("#filter", Input).display or self._state.filter:
            self._close_filter()
            self._state.set_filter("")
        else:
            self._end_values()
        self._show()

    def on_input_changed(self, event: Input.Changed) -> None:
        if event.input.display:
            self._state.set_filter(event.value)
            self._show()

    def on_input_submitted(self) -> None:
        self._close_filter()

    def _close_filter(self) -> None:
        self.query_one("#filter", Input).display = False
        self.query_one("#rows").focus()

    # --- live values

    def action_values(self) -> None:
        chosen = self._state.chosen
        if self._values is not None:
            self._end_values()
            self._show()
        elif isinstance(chosen, TopicRow):
            self._values = Values(self._node, self._model.graph, name_of(chosen))
            self._start(self._values.open())
        else:
            self.notify("only topics have values: n shows topics")

    def _end_values(self) -> None:
        if self._values is not None:
            self._start(self._values.close())
            self._values = None
