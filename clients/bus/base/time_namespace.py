"""The difference between this process's monotonic clock and those of other time namespaces:
time_namespaces(7).

Stamps are times of the monotonic clock. Processes of two containers may have different clocks, and must not
compare stamps directly.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["monotonic_offset_ns"]


def monotonic_offset_ns(path: "str | Path" = "/proc/self/timens_offsets") -> int:
    """Nanoseconds by which this process's monotonic clock is ahead of the first time namespace; 0 without
    any."""
    try:
        with open(path, encoding="utf-8") as file:  # noqa: PTH123 - programs need not import pathlib for it
            for line in file:
                match line.split():
                    case ["monotonic", seconds, nanoseconds]:
                        return int(seconds) * 1_000_000_000 + int(nanoseconds)
    except (OSError, ValueError):
        pass  # an older kernel, or no Linux: there is only one clock
    return 0
