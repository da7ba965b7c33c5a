"""The picture of a soak: latency of each kind of message over time, and memory of each process.

Needs matplotlib, which it imports late.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.looks import GREY, OURS, SOCKET
from benchmarks.pictures import THEMES, plain_ticks, save, style
from benchmarks.soaking.record import Record
from benchmarks.soaking.tables import label, order

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDTH_IN, _ROW_IN = 9.2, 2.1
_LINES = (("p50", OURS, 2.2), ("p99", SOCKET, 1.4), ("p99_9", "#CC79A7", 1.1), ("max", GREY, 0.8))
_COLOURS = ("#0A7BC8", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#A6761D", "#7F6FC6", "#C2364F", "#8C8C00")


def draw(record: Record, path: Path) -> list[Path]:
    """Draw one file for each theme, named after `path`. Raises ImportError without matplotlib, OSError."""
    import matplotlib
    from matplotlib import pyplot

    matplotlib.use("svg")
    rc_context: Any = matplotlib.rc_context  # matplotlib's types only allow known names
    written = []
    for theme in THEMES:
        with rc_context(style(theme)):
            figure = _figure(record)
            written.append(save(figure, path.with_name(f"{path.stem}-{theme}.svg")))
            pyplot.close(figure)
    return written


def _figure(record: Record) -> Any:
    from matplotlib import pyplot

    groups = sorted(record.ages, key=order)
    rows = (len(groups) + 1) // 2 + 1
    figure = pyplot.figure(figsize=(_WIDTH_IN, _ROW_IN * (rows + 0.6)))
    grid = figure.add_gridspec(rows, 2, height_ratios=[1.0] * (rows - 1) + [1.6])
    for at, group in enumerate(groups):
        _draw_latency(figure.add_subplot(grid[at // 2, at % 2]), record, group)
    _draw_memory(figure.add_subplot(grid[rows - 1, :]), record)
    if groups:
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def _draw_latency(axes: "Axes", record: Record, group: str) -> None:
    found = [(one.at_s / 60, one.latency[group]) for one in record.intervals if group in one.latency]
    for key, colour, width in _LINES:
        values = [getattr(one, key) for _, one in found]
        axes.plot([at for at, _ in found], values, color=colour, linewidth=width, label=key.replace("_", "."))
    axes.set(yscale="log", ylabel="µs")
    axes.set_title(label(group), loc="left")
    axes.minorticks_off()
    plain_ticks(axes.yaxis)


def _draw_memory(axes: "Axes", record: Record) -> None:
    times = [one.at_s / 60 for one in record.intervals]
    processes = list(record.intervals[-1].usage) if record.intervals else []
    for at, process in enumerate(processes):
        values = [one.usage[process][0] for one in record.intervals]
        axes.plot(times, values, color=_COLOURS[at % len(_COLOURS)], label=process)
    axes.set(xlabel="minutes", ylabel="MiB", ylim=(0, None))
    axes.set_title("resident memory", loc="left")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
