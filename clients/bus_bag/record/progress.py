"""The line on the terminal while recording. Pure."""

from collections import deque

from bus_bag.sizes import size_text

__all__ = ["Progress"]

_WINDOW_NS = 2_000_000_000


class Progress:
    """The line shows: time, messages, MB/s over the last two seconds, the cache, lost messages."""

    def __init__(self, began_ns: int) -> None:
        self._began_ns = began_ns
        self._looks: deque[tuple[int, int]] = deque([(began_ns, 0)])

    def line(self, now_ns: int, messages: int, size: int, cached: int, lost: int, *, is_paused: bool) -> str:
        """Make the line. `size`: bytes recorded so far, `cached`: waiting bytes."""
        self._looks.append((now_ns, size))
        while len(self._looks) > 2 and now_ns - self._looks[1][0] >= _WINDOW_NS:
            self._looks.popleft()
        then_ns, before = self._looks[0]
        rate = (size - before) / max(now_ns - then_ns, 1) * 1e3
        seconds = (now_ns - self._began_ns) // 1_000_000_000
        time = f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}"
        flow = f"{messages} messages | {rate:.1f} MB/s | cache {size_text(cached)} | lost {lost}"
        return f"{'paused' if is_paused else 'recording'} {time} | {flow}"
