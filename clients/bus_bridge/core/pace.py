"""Sending times of lossless messages: at once, or a little later and together. Pure."""

__all__ = ["GATHER_S", "Pace"]

GATHER_S = 0.001
"""Time for which messages gather."""
_CLOSE_S = 0.0003
_MOST_CLOSE = 8
"""Number of close messages in a row that leave at once; after that, messages gather."""


class Pace:
    """Pace of the messages of one tap.

    For two bridges, a few messages cost nearly as much as many that are sent together. So messages gather for
    a moment if publishers don't pause. Otherwise the bridges would use the CPU time that the publishers need
    to publish more at a time, and all would stay slow.
    """

    def __init__(self) -> None:
        self.is_gathering = False
        """Whether a new message waits for the gathered ones, and leaves with them."""
        self._last_s = 0.0
        self._close = 0

    def leaves(self, now_s: float) -> bool:
        """Whether the new messages leave at once. Otherwise messages gather from now on.

        Must not be called while messages gather.
        """
        if now_s - self._last_s >= _CLOSE_S:
            self._close = 0
        else:
            self._close += 1
            self.is_gathering = self._close > _MOST_CLOSE
        self._last_s = now_s
        return not self.is_gathering

    def gathered(self, now_s: float) -> None:
        """End the gathering: the messages leave now."""
        self.is_gathering, self._last_s = False, now_s
