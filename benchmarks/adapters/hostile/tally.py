"""Counters of a hostile program, and the words of the measuring process."""

import select
import sys

from benchmarks.worker import tell


class Tally:
    """Counts requests to busd, and how many of them busd refused. Says `ready` at the first request."""

    def __init__(self) -> None:
        self.asked = self.refused = 0
        self._is_ready = False
        self._poll = select.poll()
        self._poll.register(0, select.POLLIN)

    def add(self, asked: int, refused: int = 0, *, wait_s: float = 0.0) -> bool:
        """Count requests; returns whether to continue, after a wait of `wait_s` without a word."""
        self.asked += asked
        self.refused += refused
        if not self._is_ready:
            self._is_ready = True
            tell("ready")
        while self._poll.poll(wait_s * 1000):
            word = sys.stdin.readline()
            if not word:
                return False
            if word.strip() == "report":
                tell("flooded", asked=self.asked, refused=self.refused)
                self.asked = self.refused = 0
        return True
