"""When lossless messages leave: each at once, or some together a little later. Pure."""

__all__ = ["GATHER_S", "Pace"]

GATHER_S = 0.001
"""How long messages gather."""
_CLOSE_S = 0.0003
_MOST_CLOSE = 8
"""So many times in a row messages may come so soon after each other and leave at once; then they gather."""


class Pace:
    """Pace of the messages of one tap.

    A few messages cost two bridges nearly as much as many that go together. So where publishers don't pause,
    messages gather for a moment. Else the bridges take the processors that the publishers need to publish
    more at a time, and all stay slow.
    """

    def __init__(self) -> None:
        self.is_gathering = False
        """A new message leaves together with those gathered before."""
        self._last_s = 0.0
        self._close = 0

    def leaves(self, now_s: float) -> bool:
        """Whether what has come now is to leave at once. Otherwise messages gather from now on.

        Not to be asked while they do.
        """
        if now_s - self._last_s >= _CLOSE_S:
            self._close = 0
        else:
            self._close += 1
            self.is_gathering = self._close > _MOST_CLOSE
        self._last_s = now_s
        return not self.is_gathering

    def gathered(self, now_s: float) -> None:
        """Gathered messages leave now."""
        self.is_gathering, self._last_s = False, now_s
