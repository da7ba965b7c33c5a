"""Sizes as texts. Pure."""

__all__ = ["size_text"]

_UNITS = ("KiB", "MiB", "GiB", "TiB")


def size_text(size: float) -> str:
    """A number of bytes as rosbag2 writes it: `57 B`, `1.5 KiB`, `127.9 MiB`."""
    if size < 1024:
        return f"{size:.0f} B"
    unit = 0
    while size >= 1024 and unit < len(_UNITS):
        size /= 1024
        unit += 1
    return f"{size:.1f} {_UNITS[unit - 1]}"
