"""How far this process's monotonic clock is from that of other time namespaces: time_namespaces(7).

Stamps are of the monotonic clock. Processes of two containers may have different ones, and must not compare
them as they are.
"""

from pathlib import Path

__all__ = ["monotonic_offset_ns"]

_OFFSETS = Path("/proc/self/timens_offsets")


def monotonic_offset_ns(path: Path = _OFFSETS) -> int:
    """What this process's monotonic clock is ahead of that of the first time namespace; 0 without any."""
    try:
        for line in path.read_text("ascii").splitlines():
            match line.split():
                case ["monotonic", seconds, nanoseconds]:
                    return int(seconds) * 1_000_000_000 + int(nanoseconds)
    except (OSError, ValueError):
        pass  # an older kernel, or no Linux: then there is one clock
    return 0
