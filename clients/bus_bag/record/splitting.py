"""The time at which a bag continues in its next file. Pure."""

__all__ = ["Splitting"]

_NS_PER_S = 1_000_000_000


class Splitting:
    """Splits by bytes (`most_bytes`) and by time (`most_s`, of the log times); 0: no such limit."""

    def __init__(self, most_bytes: int, most_s: float) -> None:
        self._most_bytes = most_bytes
        self._most_ns = round(most_s * _NS_PER_S)
        self._start_ns: int | None = None
        self._before = 0

    def __bool__(self) -> bool:
        """Whether there is a limit."""
        return bool(self._most_bytes or self._most_ns)

    def is_due(self, size: int, log_time: int) -> bool:
        """Whether a message of that time belongs to the next file, if all files have `size` bytes in
        total."""
        if self._start_ns is None:
            self._start_ns = log_time
            return False
        return bool(
            (self._most_bytes and size - self._before >= self._most_bytes)
            or (self._most_ns and log_time - self._start_ns >= self._most_ns)
        )

    def split(self, size: int) -> None:
        """Record the begin of the next file."""
        self._start_ns, self._before = None, size
