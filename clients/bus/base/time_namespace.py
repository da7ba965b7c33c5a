"""How far this process's monotonic clock is from that of other time namespaces: time_namespaces(7).

Stamps are of the monotonic clock. Processes of two containers may have different ones, and must not compare
them as they are.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["monotonic_offset_ns"]


def monotonic_offset_ns(path: "str | Path" = "/proc/self/timens_offsets") -> int:
    """Nanoseconds that this process's monotonic clock is ahead of the first time namespace; 0 without any."""
    try:
        with open(path, encoding="utf-8") as file:  # noqa: PTH123 - programs need not import pathlib for it
            for line in file:
                match line.split():
                    case ["monotonic", seconds, nanoseconds]:
                        return int(seconds) * 1_000_000_000 + int(nanoseconds)
    except (OSError, ValueError):
        pass  # an older kernel, or no Linux: then there is one clock
    return 0
