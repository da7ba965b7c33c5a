"""The pictures of a report, as SVG for light and for dark pages. Needs matplotlib, which it imports late.

Knows results and the style of series, and nothing of the measurements. The same result gives the same files.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from benchmarks.figures import Spread
from benchmarks.looks import is_main, is_polling, kind_colour, look_of
from benchmarks.report import Result, Section, number
from benchmarks.systems import TUNED
from bus_cli.bench.figures import bytes_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

THEMES = {"light": ("#1f2328", "#d1d9e0"), "dark": ("#e6edf3", "#3d444d")}
"""Colours of text and of the grid for each kind of page; the background is transparent."""
PROCESSES = {"cpu_publisher": "publisher", "cpu_broker": "broker", "cpu_subscriber": "subscriber"}
_PROCESS_COLOURS = ("#0072B2", "#D55E00", "#CC79A7")
_WIDTH_IN, _LINE_IN, _PANEL_IN = 9.2, 0.24, 3.9
_LABEL_PT = 8.5
_BARS = ((64, ""), (1 << 20, ""), (1 << 20, TUNED))
"""The sizes, and the ways to use each system."""
_BAR_KEYS = ("p50", "p99", "p99.9")

Points = Mapping[float, Spread]


class Picture(NamedTuple):
    """One picture: its section, its file name, its description, and its function to draw."""

    section: str
    name: str
    alt: str
    draw: Callable[[Section], Any]

    def files(self) -> dict[str, str]:
        """The file's name for each theme."""
        return {theme: f"{self.name}-{theme}.svg" for theme in THEMES}


def available(result: Result) -> list[Picture]:
    """The pictures for which `result` has figures. Needs no matplotlib."""
    found = []
    for picture, keys in _PICTURES:
        section = result.section(picture.section)
        if section is not None and any(_lines(section, key) for key in keys or _keys(section)):
            found.append(picture)
    return found


def draw(result: Result, folder: Path) -> list[Path]:
    """Write all pictures of `result` in both themes. Raises ImportError without matplotlib, OSError."""
    import matplotlib
    from matplotlib import pyplot

    matplotlib.use("svg")
    rc_context: Any = matplotlib.rc_context  # matplotlib's types only allow known names
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for picture in available(result):
        section = result.section(picture.section)
        assert section is not None
        for theme, file in picture.files().items():
            with rc_context(style(theme)):
                figure = picture.draw(section)
                written.append(save(figure, folder / file))
                pyplot.close(figure)
    return written


def save(figure: Any, path: Path) -> Path:
    """Write it as SVG, the same for the same figure; returns `path`. Raises OSError."""
    figure.savefig(path, format="svg", metadata={"Date": None, "Creator": None})
    path.write_text("".join(line.strip() + "\n" for line in path.read_text().splitlines()))
    return path


def style(theme: str) -> dict[str, Any]:
    """matplotlib's settings for a page of that theme."""
    text, grid = THEMES[theme]
    return {
        "svg.hashsalt": "busd",
        "svg.fonttype": "none",
        "font.family": "sans-serif",
        "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial"],
        "font.size": 10,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.axisbelow": True,
        "axes.grid": True,
        "axes.titlesize": 10.5,
        "axes.titleweight": "bold",
        "grid.color": grid,
        "grid.linewidth": 0.7,
        "axes.edgecolor": grid,
        "savefig.transparent": True,
        "figure.constrained_layout.use": True,
        "legend.frameon": False,
    } | dict.fromkeys(
        ("text.color", "axes.labelcolor", "xtick.color", "ytick.color", "axes.titlecolor"), text
    )


# --- latency: from the median to the slowest


def _latency_bars(section: Section) -> Any:
    from matplotlib import pyplot

    panels = {(size, way): bars for size, way in _BARS if (bars := _bars_of(section, size, way))}
    heights = [len(part) + 2 for part in panels.values()]
    figure, grid = pyplot.subplots(
        len(panels),
        1,
        figsize=(_WIDTH_IN, sum(heights) * _LINE_IN + 0.8),
        height_ratios=heights,
        squeeze=False,
    )
    for axes, ((size, way), part) in zip(grid[:, 0], panels.items(), strict=True):
        p50, p99, largest = ([figures[key].median for _, figures in part] for key in _BAR_KEYS)
        colours = [kind_colour(series) for series, _ in part]
        faces = ["none" if is_polling(series) else kind_colour(series) for series, _ in part]
        rows = range(len(part))
        axes.hlines(rows, p50, largest, colors=colours, linewidth=1.2)
        axes.hlines(rows, p50, p99, colors=colours, linewidth=6)
        axes.scatter(largest, rows, marker="|", c=colours, s=60)
        axes.scatter(p50, rows, edgecolors=colours, c=faces, s=45, zorder=4)
        for at, value in enumerate(p50):
            _beside(axes, value, at, number(value))
        axes.set_xscale("log")
        low, high = axes.get_xlim()
        axes.set_xlim(low / 1.5, high)
        axes.set_title(", ".join(filter(None, (bytes_text(size), way))), loc="left")
        axes.grid(visible=False, axis="y")
        _name_rows(axes, [series for series, _ in part])
        plain_ticks(axes.xaxis)
    axes.set_xlabel(
        "one-way latency in µs: dot = p50 (hollow: busy polling), bar to p99, line to p99.9\n"
        "blue: busd, grey: limits, orange: rivals, pink: rivals with a broker"
    )
    return figure


def _bars_of(section: Section, size: float, way: str) -> list[tuple[str, Mapping[str, Spread]]]:
    """The series with figures at `size`, used in that `way`, or by events or polling; the fastest first."""
    found = {
        row.series.removesuffix(f", {way}"): row.figures
        for row in section.rows
        if row.at == size and set(_BAR_KEYS) <= row.figures.keys()
        if (row.series.endswith(f", {way}") if way else is_main(row.series) or is_polling(row.series))
    }
    return sorted(found.items(), key=lambda item: item[1]["p50"].median)


# --- lines over a size or a number


def _latency_sizes(section: Section) -> Any:
    return _panels(
        [("p50", _lines(section, "p50"), "median latency in µs")], "size of the message", bytes_text
    )


def _throughput(section: Section) -> Any:
    lines = [("messages", "per_s", "messages/s"), ("bytes", "bytes_per_s", "bytes/s")]
    panels = [(title, _lines(section, key), label) for title, key, label in lines]
    return _panels(panels, "size of the message", bytes_text)


def _fan_out(section: Section) -> Any:
    lines = [
        ("all deliveries", "deliveries_per_s", "deliveries/s"),
        ("until the last subscriber has it", "last_p50", "median in µs"),
    ]
    panels = [(title, _lines(section, key), label) for title, key, label in lines]
    return _panels([one for one in panels if one[1]], "subscribers' processes", str)


def _growth(section: Section) -> Any:
    """A row for each kind of work, with its first two figures: cost over the varied number."""
    from matplotlib import pyplot

    headings = section.headings()
    panels = _growth_panels(section)
    figure, grid = pyplot.subplots(len(panels), 2, figsize=(_WIDTH_IN, 2.3 * len(panels)), squeeze=False)
    for row, (what, keys) in zip(grid, panels.items(), strict=True):
        for axes, key in zip(row, keys, strict=False):
            lines = section.lines(key)
            _draw_lines(axes, {name: lines[name] for name in lines if name.startswith(f"{what}: ")}, _short)
            axes.set(xlabel=what)
            axes.set_title(headings[key], loc="left")
        for axes in row[len(keys) :]:
            axes.set_axis_off()
    handles, labels = grid[0, 0].get_legend_handles_labels()
    names = [label.partition(": ")[2] for label in labels]
    figure.legend(handles, names, loc="outside upper center", ncols=len(names))
    return figure


def _growth_panels(section: Section) -> dict[str, list[str]]:
    """The keys of the figures to draw, for each kind of work."""
    found: dict[str, list[str]] = {}
    for column in section.columns:
        for series in section.lines(column.key):
            what, colon, _ = series.partition(": ")
            keys = found.setdefault(what, []) if colon else []
            if len(keys) < 2 and column.key not in keys:
                keys.append(column.key)
    return found


def _lines(section: Section, key: str) -> dict[str, Points]:
    """The series to draw: the standard way of each system, and the limits."""
    lines = section.lines(key)
    return {name: points for name, points in lines.items() if is_main(name) or ": " in name}


def _keys(section: Section) -> list[str]:
    return [column.key for column in section.columns]


def _panels(
    panels: Sequence[tuple[str, Mapping[str, Points], str]], xlabel: str, tick: Callable[[int], str]
) -> Any:
    """Panels one below the other. The names on the right have the order in which the first panel's lines
    begin."""
    from matplotlib import pyplot

    figure, grid = pyplot.subplots(
        len(panels), 1, figsize=(_WIDTH_IN, _PANEL_IN * len(panels)), squeeze=False
    )
    for axes, (title, lines, ylabel) in zip(grid[:, 0], panels, strict=True):
        _draw_lines(axes, lines, tick)
        axes.set(xlabel=xlabel, ylabel=ylabel)
        if len(panels) > 1:
            axes.set_title(title, loc="left")
    first = panels[0][1]
    order = sorted(first, key=lambda name: -next(iter(first[name].values())).median)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    by_name = dict(zip(labels, handles, strict=True))
    legend = figure.legend([by_name[name] for name in order], order, loc="outside right upper")
    for text in legend.get_texts():
        text.set_fontweight("bold" if look_of(text.get_text()).is_ours else "normal")
    return figure


def _draw_lines(axes: "Axes", lines: Mapping[str, Points], tick: Callable[[int], str]) -> None:
    for series, points in lines.items():
        look = look_of(series.rpartition(": ")[2])
        axes.plot(
            list(points),
            [spread.median for spread in points.values()],
            color=look.colour,
            marker=look.marker,
            linestyle=look.dashes,
            linewidth=2.8 if look.is_ours else 1.4,
            markersize=6,
            zorder=4 if look.is_ours else 3,
            label=series,
        )
    axes.set(xscale="log", yscale="log")
    ticks = sorted({at for points in lines.values() for at in points})
    axes.set_xticks(ticks, [tick(int(at)) for at in ticks])
    axes.minorticks_off()
    # Show at least a decade; otherwise noise fills the picture.
    values = [spread.median for points in lines.values() for spread in points.values()]
    low, high = min(values), max(values)
    room = max(1.3, (10 * low / high) ** 0.5)
    axes.set_ylim(low / room, high * room)
    plain_ticks(axes.yaxis)


# --- CPU time, by process


def _cpu_bars(section: Section) -> Any:
    from matplotlib import pyplot

    lines = {key: section.lines(key) for key in PROCESSES}
    found = {
        series: [_only(lines[key].get(series, {})) for key in PROCESSES]
        for series in section.lines("cpu_publisher")
        if is_main(series)
    }
    rows = sorted(found.items(), key=lambda item: sum(item[1]))
    figure, axes = pyplot.subplots(figsize=(_WIDTH_IN, (len(rows) + 2) * _LINE_IN + 0.9))
    for at, (_, parts) in enumerate(rows):
        left = 0.0
        for part, colour, name in zip(parts, _PROCESS_COLOURS, PROCESSES.values(), strict=True):
            axes.barh(at, part, left=left, height=0.7, color=colour, label=name if at == 0 else None)
            left += part
        _beside(axes, left, at, number(left), to_the_right=True)
    axes.grid(visible=False, axis="y")
    axes.margins(x=0.08)
    axes.set_xlabel("CPU s per 100,000 messages")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(PROCESSES))
    _name_rows(axes, [series for series, _ in rows])
    return figure


def _only(points: Points) -> float:
    return next(iter(points.values())).median if points else 0.0


# --- helpers


def _name_rows(axes: "Axes", names: Sequence[str]) -> None:
    """Names of rows, the first at the top; ours in bold."""
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    for text, name in zip(axes.get_yticklabels(), names, strict=True):
        text.set_fontweight("bold" if look_of(name).is_ours else "normal")


def _beside(axes: "Axes", x: float, y: float, text: str, *, to_the_right: bool = False) -> None:
    axes.annotate(
        text,
        (x, y),
        xytext=(6 if to_the_right else -7, 0),
        textcoords="offset points",
        ha="left" if to_the_right else "right",
        va="center",
        fontsize=_LABEL_PT,
    )


def plain_ticks(axis: Any) -> None:
    """Use 10, 20, 50, 100, ... 10k as ticks, as many as fit, instead of powers of ten."""
    from matplotlib.ticker import LogLocator

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=8))
    axis.set_major_formatter(lambda value, _: _short(value))


def _short(value: float) -> str:
    """A number without the zeros at the end of `number`."""
    text = number(value)
    unit = text[-1] if text[-1] in "kMG" else ""
    return f"{float(text.rstrip('kMG')):g}{unit}"


_PICTURES: tuple[tuple[Picture, tuple[str, ...]], ...] = (
    (
        Picture(
            "latency",
            "latency",
            "latency of 64 B and 1 MiB: p50, p99 and p99.9 of each system",
            _latency_bars,
        ),
        ("p50",),
    ),
    (Picture("latency", "latency-sizes", "median latency over the size", _latency_sizes), ("p50",)),
    (Picture("throughput", "throughput", "messages/s and bytes/s over the size", _throughput), ("per_s",)),
    (
        Picture(
            "fanout",
            "fanout",
            "deliveries/s and the time to the last over the number of subscribers",
            _fan_out,
        ),
        ("deliveries_per_s",),
    ),
    (
        Picture("cost", "cost", "CPU time of 100,000 messages by process", _cpu_bars),
        ("cpu_publisher",),
    ),
    (Picture("growth", "growth", "what more work costs", _growth), ()),
)
