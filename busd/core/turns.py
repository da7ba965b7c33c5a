"""When each process is served: they take turns, and no turn does more work than the budget.

A *party* is one process; more connections give it no more. Work is counted in units of about a microsecond
(`busd.core.work`), so all of this is the same on any machine, and no clock is read here.

A party that asks for little is served at once, out of an allowance that fills up again with time. A party
that has used it up, or that leaves work behind, waits in the line. The shell serves one turn of the line
between two looks at its sockets. So a party within its allowance waits for the current turn, at most for two.
A party that has used it up waits, with n parties in the line, for the n - 1 turns of the others.
"""

from collections import deque
from collections.abc import Hashable
from typing import Generic, TypeVar
from weakref import WeakValueDictionary

__all__ = ["BUDGET", "Party", "Turns"]

BUDGET = 250
"""Work of one turn: short enough for others to wait for, long enough to make changing turns cheap."""
_REFILL_NS = 10_000
"""The time in which one unit comes back: so a party may use a tenth of busd's time without waiting in
line."""

Job = TypeVar("Job", bound=Hashable)


class Party(Generic[Job]):
    """One process: the jobs that wait for its turn, and the work that it may cause before it has to wait.

    A step that costs more than `left` makes it negative; later turns get so much less.
    """

    __slots__ = ("__weakref__", "_refilled_ns", "is_in_line", "jobs", "left")

    def __init__(self) -> None:
        self.left = BUDGET
        self.jobs: deque[Job] = deque()
        self.is_in_line = False
        """It waits for its turn, or it is its turn."""
        self._refilled_ns = 0

    def refill(self, now_ns: int) -> None:
        """Add the units that have come back since the last call."""
        units = (now_ns - self._refilled_ns) // _REFILL_NS
        if units:
            self._refilled_ns = now_ns
            self.left = min(self.left + units, BUDGET)


class Turns(Generic[Job]):
    """The parties, and the line of waiting parties."""

    def __init__(self) -> None:
        self._parties: WeakValueDictionary[Hashable, Party[Job]] = WeakValueDictionary()
        self._line: deque[Party[Job]] = deque()
        self._waiting: set[Job] = set()

    def party(self, name: Hashable) -> Party[Job]:
        """The party of that name; it is known as long as something holds it."""
        party = self._parties.get(name)
        if party is None:
            party = self._parties[name] = Party()
        return party

    def __bool__(self) -> bool:
        return bool(self._line)

    def may_go(self, now_ns: int, party: Party[Job]) -> bool:
        """Whether `party` may be served now, out of its allowance."""
        if party.jobs:
            return False
        party.refill(now_ns)
        return party.left > 0

    def wait(self, party: Party[Job], job: Job) -> None:
        """`job` waits for a turn of `party`, after its others; it may do so already."""
        if job not in self._waiting:
            self._waiting.add(job)
            party.jobs.append(job)
            if not party.is_in_line:
                party.is_in_line = True
                self._line.append(party)

    def is_waiting(self, job: Job) -> bool:
        return job in self._waiting

    def begin(self) -> Party[Job]:
        """The turn of the party that has waited longest begins; `end` ends it. There must be one."""
        party = self._line.popleft()
        party.left = min(party.left + BUDGET, BUDGET)
        return party

    def next_job(self, party: Party[Job]) -> Job | None:
        """The job to go on with in this turn; None if the turn is over. It may `wait` again."""
        if party.left <= 0 or not party.jobs:
            return None
        job = party.jobs.popleft()
        self._waiting.discard(job)
        return job

    def end(self, party: Party[Job]) -> None:
        """The turn is over; a party with more to do goes to the end of the line."""
        party.is_in_line = bool(party.jobs)
        if party.is_in_line:
            self._line.append(party)
