"""A test's end of `survivors.py`: starts talkers and listeners, kills, stops and questions them.

It also has functions to inspect a process from outside: its descriptors, mappings, memory and state.
"""

import contextlib
import os
import random
import signal
import socket
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec

import cli
import survivors
from conftest import WAIT_S
from neighbours import wait_until
from survivors import EARS, WORD_BYTES, Ear, Listen, Role, Talk


class Actor:
    """A process with a role. `ask` needs it to be `ready`."""

    def __init__(self, role: Role, pid: int, channel: socket.socket, line: socket.socket) -> None:
        self.role = role
        self.name = role.name
        self.pid = pid
        self.has_ended = False
        self._channel = channel
        self._answers = channel.makefile("rb")
        self._line = line

    def ready(self) -> Self:
        """Wait until it has its endpoints."""
        assert self._answer() == "ready"
        return self

    def ask(self, question: str, value: object = None) -> Any:
        self._channel.sendall(msgspec.json.encode((question, value)) + b"\n")
        return self._answer()

    @property
    def said(self) -> int:
        """For a talker: the number up to which it has promised all messages."""
        return self._noted(0)

    @property
    def waits(self) -> bool:
        """For a talker: whether it waits for room."""
        return self._noted(1) > self._noted(0)

    def heard(self, talker: "Actor", ear: int = 0) -> int:
        """For a listener: the last number received from that talker."""
        assert isinstance(talker.role, Talk)
        return self._noted(talker.role.talker * EARS + ear)

    def hears(self, talker: "Actor", more: int = 0) -> None:
        """For a listener: wait until each ear has received all messages promised so far, and `more`."""
        assert isinstance(self.role, Listen)
        goal, ears = talker.said + more, range(len(self.role.ears))
        until_at_least(goal, lambda: min(self.heard(talker, ear) for ear in ears))

    def hears_out(self, *talkers: "Actor") -> None:
        """For a listener: wait until its first ear, a keep-all one, has received all promised messages.

        And until the others have taken or lost as many: a small depth may lose the last messages of a talker
        that died.
        """
        for talker in talkers:
            until_at_least(talker.said, partial(self.heard, talker))

        def look() -> tuple[int, int]:
            found = self.ask("accounts")
            totals = [delivered + dropped for delivered, _, dropped in found]
            return max(totals) - min(totals), sum(queued for _, queued, _ in found)

        until_equal((0, 0), look)

    def goes_on(self, messages: int) -> None:
        """For a talker: wait until it has promised `messages` more."""
        until_at_least(self.said + messages, lambda: self.said)

    def has_heard_all(self, *totals: tuple["Actor", int]) -> None:
        """For a listener: wait until each ear has received talkers to their ends, and accounts for all."""
        assert isinstance(self.role, Listen)
        ears = range(len(self.role.ears))
        last = [number for _, number in totals]
        until_equal(
            [last for _ in ears], lambda: [[self.heard(one, ear) for one, _ in totals] for ear in ears]
        )
        until_equal([sum(last) for _ in ears], lambda: list(map(sum, self.ask("accounts"))))

    def kill(self) -> None:
        """kill -9"""
        self._end(signal.SIGKILL)

    def leave(self) -> None:
        """Let it end in order."""
        self._channel.sendall(b'["leave",null]\n')
        status = self._end()
        assert not status, f"{self.name} ended with {status}"

    def stop(self) -> None:
        os.kill(self.pid, signal.SIGSTOP)
        wait_until(lambda: state(self.pid) == "T")

    def resume(self) -> None:
        os.kill(self.pid, signal.SIGCONT)

    def _end(self, with_signal: int = 0) -> int:
        assert not self.has_ended
        self.has_ended = True
        os.kill(self.pid, with_signal)  # the pid is not reused before its status was read
        self._line.send(b"%d" % self.pid)
        status = int(self._line.recv(64))
        self._answers.close()
        self._channel.close()
        return status

    def _noted(self, place: int) -> int:
        try:
            with open(self.role.ledger, "rb") as ledger:  # noqa: PTH123
                ledger.seek(place * WORD_BYTES)
                return int.from_bytes(ledger.read(WORD_BYTES), "little")
        except FileNotFoundError:
            return 0

    def _answer(self) -> Any:
        line = self._answers.readline()
        assert line, f"{self.name} has ended"
        return msgspec.json.decode(line)


class Nursery:
    """Starts actors. Leaving kills living ones, and asserts that no actor reported a fault."""

    def __init__(self, folder: Path, chance: random.Random) -> None:
        self._folder = folder
        self._chance = chance
        self._faults = folder / "faults"
        self._errors = folder / "errors"
        self._faults.touch()
        self._actors: list[Actor] = []
        self._talkers = self._listeners = 0

    def __enter__(self) -> Self:
        self._line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._line.settimeout(WAIT_S)
        with theirs, self._errors.open("ab") as errors:
            streams = theirs.fileno(), errors.fileno(), errors.fileno()
            self._process = cli.begin([survivors.__file__], streams)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for actor in self._actors:
            if not actor.has_ended:
                actor.kill()
        self._line.close()
        self._process.wait(WAIT_S)
        faults, errors = self._faults.read_text(), self._errors.read_text()
        if error is not None:
            print(faults, errors)
        else:
            self.look()
            assert "Traceback" not in errors, errors

    def look(self) -> None:
        """Assert that no actor has seen a torn, lost, repeated or reordered message so far."""
        faults = self._faults.read_text()
        assert not faults, faults[:2000]

    def talker(self, **options: Any) -> Actor:
        """A process that publishes; options are the fields of `Talk`."""
        self._talkers += 1
        name = f"talker{self._talkers}"
        seed = self._chance.getrandbits(32)
        return self._start(Talk(**self._common(name), talker=self._talkers, seed=seed, **options))

    def listener(self, *ears: Ear, keeps_rings: bool = False) -> Actor:
        """Start a process that subscribes; with `keeps_rings` it keeps all received descriptors of rings."""
        self._listeners += 1
        common = self._common(f"listener{self._listeners}")
        return self._start(Listen(**common, ears=list(ears), keeps_rings=keeps_rings))

    def _common(self, name: str) -> dict[str, Any]:
        return {
            "name": name,
            "ledger": str(self._folder / name),
            "faults": str(self._faults),
            "loop": self._chance.choice(("asyncio", "uvloop")),
        }

    def _start(self, role: Role) -> Actor:
        ours, theirs = socket.socketpair()
        ours.settimeout(WAIT_S)
        with theirs:
            socket.send_fds(self._line, [msgspec.json.encode(role)], [theirs.fileno()])
        actor = Actor(role, int(self._line.recv(64)), ours, self._line)
        self._actors = [one for one in self._actors if not one.has_ended]
        self._actors.append(actor)
        return actor


# --- waiting


def until_equal(expected: object, look: Callable[[], object]) -> None:
    """Wait until `look()` returns the expected value; a failure shows the value instead."""
    with contextlib.suppress(TimeoutError):
        wait_until(lambda: look() == expected)
    seen = look()
    assert seen == expected, f"{seen} instead of {expected}"


def until_at_least(goal: int, look: Callable[[], int]) -> None:
    """As `until_equal`, for a number that grows."""
    with contextlib.suppress(TimeoutError):
        wait_until(lambda: look() >= goal)
    seen = look()
    assert seen >= goal, f"{seen} instead of {goal} or more"


def until_alone(*actors: Actor) -> None:
    """Wait until the graph has only these nodes and their endpoints."""
    names = {actor.name for actor in actors}

    def look() -> list[set[str]]:
        graph = actors[0].ask("graph")
        return [set(graph["nodes"]), set(graph["endpoints"])]

    until_equal([names, names], look)


def settle(*actors: Actor) -> None:
    """Wait until all messages for their matches are exchanged (listeners first).

    In the first round they learn of the matches, in the second of the answers of the others.
    """
    for actor in actors * 2:
        actor.ask("graph")


# --- views of a process


def state(pid: int) -> str:
    """The state, as in ps: R, S, T and so on."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]


def cpu_ticks(pid: int) -> int:
    """Processor time used so far, in ticks of 10 ms."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return int(fields[11]) + int(fields[12])


def private_bytes(pid: int) -> int:
    """Memory that a process holds now, without shared memory (a ring may grow to 64 MiB)."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("RssAnon")) << 10


def holdings(pid: int) -> Counter[str]:
    """The number of open descriptors and mappings of each kind that may come from the bus."""
    found: Counter[str] = Counter()
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        try:
            found[f"open {_kind(str(entry.readlink()))}"] += 1
        except FileNotFoundError:
            continue  # the listing descriptor, or closed meanwhile
    for line in Path(f"/proc/{pid}/maps").read_text().splitlines():
        name = line[73:]
        if name.startswith(("/memfd:", "/dev/shm")):
            found[f"mapped {_kind(name)}"] += 1
    return found


def _kind(name: str) -> str:
    return name.removesuffix(" (deleted)").partition(":[")[0] if name.startswith(("socket", "pipe")) else name
