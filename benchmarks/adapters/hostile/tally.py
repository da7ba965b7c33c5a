"""What a hostile program has done, and the words of the process that measures."""

import select
import sys

from benchmarks.worker import tell


class Tally:
    """Counts what was asked of busd, and how much of that was refused; says `ready` when the first was."""

    def __init__(self) -> None:
        self.asked = self.refused = 0
        self._is_ready = False
        self._poll = select.poll()
        self._poll.register(0, select.POLLIN)

    def add(self, asked: int, refused: int = 0, *, wait_s: float = 0.0) -> bool:
        """Count what was done; returns whether to go on, after `wait_s` where no word comes meanwhile."""
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
