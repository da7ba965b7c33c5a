"""Numbers as short texts, for the narrow columns of `bus top`. Pure."""

from collections.abc import Sequence

from bus_cli.output import size_text
from bus_plot.bars import bars_text, joined

__all__ = [
    "NONE",
    "SPARK_CELLS",
    "bytes_text",
    "count_text",
    "losses_text",
    "rate_text",
    "seconds_text",
    "spark_text",
]

NONE = "-"
"""Text for an unknown or missing value."""
SPARK_CELLS = 10
_HEADROOM = 1.5
"""A constant rate is drawn at two thirds of the height, so changes in both directions are visible."""


def rate_text(rate: float | None) -> str:
    """A rate such as `29.9`; `-` if it is unknown."""
    if rate is None:
        return NONE
    if rate >= 1e6:
        return count_text(int(rate))
    return (
        f"{rate:.0f}" if rate >= 1000 or rate == int(rate) else f"{rate:.1f}" if rate >= 10 else f"{rate:.2f}"
    )


def count_text(count: int) -> str:
    """A count in at most seven characters."""
    for size, unit in ((10**12, "T"), (10**9, "G"), (10**6, "M")):
        if count >= size:
            return f"{count / size:.2f}{unit}" if count < 1000 * size else f"{count // size}{unit}"
    return str(count)


def bytes_text(rate: float | None) -> str:
    return NONE if rate is None else size_text(rate)


def seconds_text(seconds: float) -> str:
    """A time in the unit that fits, in at most seven characters: `12.3 ms`."""
    for size, unit in ((1.0, "s"), (1e-3, "ms")):
        if seconds >= size:
            return _short(seconds / size, unit)
    return _short(seconds * 1e6, "µs")


def _short(value: float, unit: str) -> str:
    return f"{value:.0f} {unit}" if value >= 100 else f"{value:.1f} {unit}"


def spark_text(history: Sequence[float], cells: int = SPARK_CELLS) -> str:
    """The rates of the last seconds as bars."""
    shown = history[-cells:]
    return bars_text(shown, _HEADROOM * max(shown, default=0.0)).rjust(cells)


def losses_text(history: Sequence[float], cells: int = SPARK_CELLS) -> str:
    """The messages lost in the last minute as bars; empty if none was lost."""
    return bars_text(joined(history, cells)) if any(history) else ""
