"""Output of the verbs: texts, JSON lines, tables, sizes. Knows nothing of the bus.

Verbs write only through `say`, `complain` or `print_json`, because output may contain texts of other
programs.
"""

import select
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bus.base.printable import printable, printable_json

__all__ = ["CommandError", "complain", "dropped_text", "print_json", "reader", "say", "size_text", "table"]


class CommandError(Exception):
    """A verb failed: its text goes to stderr, and the exit code is 1."""


def say(*words: object, sep: str = " ", end: str = "\n") -> None:
    """Print like print(), but escape control characters except newlines and tabs, on a terminal or not."""
    sys.stdout.write(printable(sep.join(map(str, words))) + end)


def complain(text: object) -> None:
    """Print a text for the user to stderr, beside the output."""
    print(printable(str(text)), file=sys.stderr, flush=True)


def print_json(record: Any) -> None:
    """Print one object on one line. NaN and infinity become null, because JSON does not have them."""
    from msgspec import json

    sys.stdout.write(printable_json(json.encode(record).decode()) + "\n")


def show(text: object, record: Any, *, as_json: bool) -> None:
    """Print one result of a verb: its `text`, or with --json its `record`."""
    if as_json:
        print_json(record)
    else:
        say(text)


def reader() -> select.epoll | None:
    """An epoll that is ready as soon as the reader of the output is gone; None if that can't be detected.

    The caller closes it. Verbs that only print watch it. Else they would notice it at their next line, maybe
    in an hour.
    """
    try:
        watch = select.epoll()
        watch.register(sys.stdout.fileno(), 0)  # epoll always reports a hang-up
    except (OSError, ValueError):  # a file, or no stdout
        return None
    return watch


def size_text(size: float) -> str:
    """A number of bytes as ros2 writes it, in steps of 1,000: `57 B`, `1.50 KB`, `2.00 MB`."""
    return in_unit(size, unit_of(size))


def unit_of(size: float) -> int:
    """The unit for a size: 0 for B, 1 for KB, 2 for MB."""
    return 0 if size < 1000 else 1 if size < 1_000_000 else 2


def in_unit(size: float, unit: int) -> str:
    return f"{size:.0f} B" if unit == 0 else f"{size / 1000**unit:.2f} {('KB', 'MB')[unit - 1]}"


def dropped_text(dropped: Mapping[str, int]) -> str:
    """The total of drops with the count for each reason: `12 (replaced: 12)`."""
    reasons = ", ".join(f"{reason}: {count}" for reason, count in sorted(dropped.items()))
    return f"{sum(dropped.values())} ({reasons})" if reasons else "0"


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table with centred titles and a line of `=`, as in `ros2 topic hz`."""
    body = [list(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(header, *body, strict=True)]
    lines = ["   ".join(title.center(width) for title, width in zip(header, widths, strict=True))]
    lines.append("=" * (sum(widths) + 3 * (len(widths) - 1)))
    lines += ["   ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in body]
    return "\n".join(lines) + "\n"
