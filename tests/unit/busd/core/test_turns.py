"""busd.core.turns: no turn is longer than the budget, and a process with few requests hardly waits.

`Line` replaces the shell: it looks at all sockets, then serves one turn, again and again. The test sets the
clock; a unit of work takes a microsecond.
"""

from collections import Counter

import pytest

from busd.core.turns import BUDGET, Party, Turns

STEP = 10
READ = 5


class Line:
    """Connections with work to do, and the order in which the work is done."""

    def __init__(self) -> None:
        self.turns: Turns[str] = Turns()
        self.now_ns = 0
        self.parties: dict[str, Party[str]] = {}
        self.wanted: Counter[str] = Counter()
        """Units of work for each connection that are not done yet."""
        self.done: list[tuple[str, int]] = []
        """The connections served, one after the other, each with its time."""

    def connect(self, connection: str, process: str) -> None:
        self.parties[connection] = self.turns.party(process)

    def work_on(self, connection: str) -> None:
        """Do the work of the connection until the party has nothing left."""
        party, spent = self.parties[connection], READ
        party.left -= READ
        while self.wanted[connection] > 0 and party.left > 0:
            self.wanted[connection] -= STEP
            party.left -= STEP
            spent += STEP
        if self.wanted[connection] > 0:
            self.turns.wait(party, connection)
        self.now_ns += spent * 1000
        self.done.append((connection, spent))

    def look(self) -> None:
        """The event loop reports each socket with something to read."""
        for connection, party in self.parties.items():
            if self.wanted[connection] > 0 and not self.turns.is_waiting(connection):
                if self.turns.may_go(self.now_ns, party):
                    self.work_on(connection)
                else:
                    self.turns.wait(party, connection)

    def serve(self) -> None:
        if self.turns:
            party = self.turns.begin()
            while (connection := self.turns.next_job(party)) is not None:
                self.work_on(connection)
            self.turns.end(party)

    def run(self, rounds: int) -> None:
        for _ in range(rounds):
            self.look()
            self.serve()


@pytest.fixture
def line() -> Line:
    return Line()


def test_little_is_done_at_once(line: Line) -> None:
    line.connect("quiet", "a")
    for _ in range(1000):
        line.wanted["quiet"] = STEP
        line.look()
        assert not line.wanted["quiet"]
        line.now_ns += 1_000_000  # at this rate of 1 kHz, it never has to wait
        assert not line.turns


@pytest.mark.parametrize("wanted", [BUDGET - READ, BUDGET, 100 * BUDGET])
def test_no_turn_is_longer_than_the_budget(line: Line, wanted: int) -> None:
    line.connect("greedy", "a")
    line.wanted["greedy"] = wanted
    line.run(300)
    assert not +line.wanted
    assert max(spent for _, spent in line.done) < BUDGET + STEP


@pytest.mark.parametrize("busy", [1, 2, 10])
def test_a_quiet_one_waits_for_as_many_turns_as_there_are_busy_ones(line: Line, busy: int) -> None:
    for number in range(busy):
        line.connect(f"busy {number}", f"process {number}")
        line.wanted[f"busy {number}"] = 1 << 40
    line.run(2 * busy)  # all have used up their budgets
    line.connect("quiet", "quiet")
    for _ in range(100):
        line.serve()  # the work arrives during another turn
        line.wanted["quiet"] = STEP
        before = len(line.done)
        line.look()
        assert "quiet" in {connection for connection, _ in line.done[before:]}
        assert sum(spent for _, spent in line.done[before:]) <= busy * (BUDGET + STEP) + STEP + READ
        line.now_ns += 1_000_000


def test_busy_ones_take_turns(line: Line) -> None:
    for number in range(5):
        line.connect(f"c{number}", f"p{number}")
        line.wanted[f"c{number}"] = 1 << 40
    line.run(5)
    line.done.clear()
    line.run(50)
    assert [connection for connection, _ in line.done] == [f"c{number}" for number in range(5)] * 10


def test_many_connections_are_one_process(line: Line) -> None:
    for number in range(40):
        line.connect(f"greedy {number}", "greedy")
        line.wanted[f"greedy {number}"] = 1 << 40
    line.connect("other", "other")
    line.wanted["other"] = 1 << 40
    line.run(10)
    line.done.clear()
    line.run(400)
    work = Counter[str]()
    for connection, spent in line.done:
        work[connection.split()[0]] += spent
    assert 0.9 < work["greedy"] / work["other"] < 1.1
    served = [connection for connection, _ in line.done if connection != "other"]
    assert len(set(served)) == 40  # each of them had a turn


def test_many_small_requests_over_many_connections_are_bounded_too(line: Line) -> None:
    """Each connection asks for less than a turn. All together ask for much more."""
    for number in range(40):
        line.connect(f"c{number}", "greedy")
    for _ in range(20):
        for number in range(40):
            line.wanted[f"c{number}"] = BUDGET // 4
        before = len(line.done)
        line.look()
        assert sum(spent for _, spent in line.done[before:]) < BUDGET + BUDGET // 4
        line.serve()


def test_a_debt_is_paid(line: Line) -> None:
    """If a step costs more than the budget, the process pays for it with its next turns."""
    line.connect("greedy", "a")
    line.connect("other", "b")
    for connection in ("greedy", "other"):
        line.wanted[connection] = 1 << 40
    line.run(4)
    line.parties["greedy"].left -= 3 * BUDGET
    line.done.clear()
    line.run(8)
    assert [connection for connection, _ in line.done].count("other") == 4
    assert [connection for connection, _ in line.done].count("greedy") == 1


def test_the_allowance_comes_back_with_time(line: Line) -> None:
    party = line.turns.party("a")
    assert line.turns.may_go(line.now_ns, party)
    party.left = -100
    assert not line.turns.may_go(line.now_ns, party)
    line.now_ns += 100 * 10_000
    assert not line.turns.may_go(line.now_ns, party)
    line.now_ns += 10_000
    assert line.turns.may_go(line.now_ns, party)
    line.now_ns += 1 << 60
    assert line.turns.may_go(line.now_ns, party)
    assert party.left == BUDGET  # and not more than that


def test_a_party_is_forgotten_with_its_last_connection(line: Line) -> None:
    party = line.turns.party("a")
    assert line.turns.party("a") is party
    party.left = -100
    del party
    assert line.turns.party("a").left == BUDGET
