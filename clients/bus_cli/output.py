"""How verbs say things: texts, JSON lines, tables, sizes. Knows nothing of the bus.

Whatever a verb writes goes through `say`, `complain` or `print_json`, for there may be texts of others in it.
"""

import select
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bus.base.printable import printable, printable_json

__all__ = ["CommandError", "complain", "dropped_text", "print_json", "reader", "say", "size_text", "table"]


class CommandError(Exception):
    """A verb can't do what it was asked to: the text goes to stderr, the exit code is 1."""


def say(*words: object, sep: str = " ", end: str = "\n") -> None:
    """As print(), with control characters but newlines and tabs escaped: wherever the output goes."""
    sys.stdout.write(printable(sep.join(map(str, words))) + end)


def complain(text: object) -> None:
    """Tell the user something that is not the output."""
    print(printable(str(text)), file=sys.stderr, flush=True)


def print_json(record: Any) -> None:
    """One object on one line; what JSON has no number for (NaN, infinity) is null."""
    from msgspec import json

    sys.stdout.write(printable_json(json.encode(record).decode()) + "\n")


def show(text: object, record: Any, *, as_json: bool) -> None:
    """One result of a verb: `text`, or with --json the `record`."""
    if as_json:
        print_json(record)
    else:
        say(text)


def reader() -> select.epoll | None:
    """An epoll that is ready as soon as nobody reads what is printed any more; None where that can't be told.

    To be closed. Verbs that only print watch it: else they would notice with the next line, maybe in an hour.
    """
    try:
        watch = select.epoll()
        watch.register(sys.stdout.fileno(), 0)  # the end is told whatever is asked for
    except (OSError, ValueError):  # a file, or nothing at all
        return None
    return watch


def size_text(size: float) -> str:
    """Bytes as ros2 writes them: `57 B`, `1.50 KB`, `2.00 MB`, in thousands."""
    return in_unit(size, unit_of(size))


def unit_of(size: float) -> int:
    """How many times a thousand fits: 0 for B, 1 for KB, 2 for MB."""
    return 0 if size < 1000 else 1 if size < 1_000_000 else 2


def in_unit(size: float, unit: int) -> str:
    return f"{size:.0f} B" if unit == 0 else f"{size / 1000**unit:.2f} {('KB', 'MB')[unit - 1]}"


def dropped_text(dropped: Mapping[str, int]) -> str:
    """The total, and how much each reason has in it: `12 (replaced: 12)`."""
    reasons = ", ".join(f"{reason}: {count}" for reason, count in sorted(dropped.items()))
    return f"{sum(dropped.values())} ({reasons})" if reasons else "0"


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Columns under centred titles and a line of `=`, as `ros2 topic hz` draws them."""
    body = [list(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(header, *body, strict=True)]
    lines = ["   ".join(title.center(width) for title, width in zip(header, widths, strict=True))]
    lines.append("=" * (sum(widths) + 3 * (len(widths) - 1)))
    lines += ["   ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in body]
    return "\n".join(lines) + "\n"
