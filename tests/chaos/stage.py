"""The director's end of the actors: starts, orders, kills and stops them, and reads their notes."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec
from msgspec.structs import replace

from chaos import cgroup
from chaos.actor import BEGUN, DONE
from chaos.roles import Look, Role
from survivors import WORD_BYTES

PATIENCE_S = 60.0
"""The longest wait for any event; only a machine that stands still needs so long."""


class Gone(Exception):
    """The actor has ended."""


class Actor:
    """A process with a role. Orders are sent at once, and answered when their turn comes."""

    def __init__(self, role: Role, pid: int, channel: socket.socket) -> None:
        self.role = role
        self.pid = pid
        self._channel = channel
        self._answers = channel.makefile("rb")
        self._due = deque(["ready"])

    def order(self, order: str, value: object = None) -> None:
        """Send an order without waiting. Raises Gone."""
        try:
            self._channel.sendall(msgspec.json.encode((order, value)) + b"\n")
        except OSError:
            raise Gone(self.role.name) from None
        self._due.append(order)

    def ask(self, order: str, value: object = None) -> Any:
        """The answer, after the answers to all earlier orders. Raises Gone."""
        self.order(order, value)
        while self._due:
            try:
                line = self._answers.readline()
            except TimeoutError:
                raise TimeoutError(f"{self.role.name} does not answer to {self._due[0]}") from None
            except OSError:
                line = b""
            if not line:
                raise Gone(self.role.name)
            self._due.popleft()
        return msgspec.json.decode(line)

    def look(self) -> Look:
        return msgspec.convert(self.ask("look"), Look, strict=False)

    def signal(self, number: int) -> None:
        os.kill(self.pid, number)  # the pid is not reused before its status was read

    def leave(self) -> None:
        """Order it to end."""
        with contextlib.suppress(OSError):
            self._channel.sendall(b'["leave",null]\n')

    def close(self) -> None:
        self._answers.close()
        self._channel.close()


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    """Delay a Ctrl-C: between an actor's start and its entry in `actors`, no code would end it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Stage:
    """The living actors, in `folder`. Leaving kills them."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self.folder = folder
        self.actors: dict[str, Actor] = {}
        self._environment = environment
        self._faults = folder / "faults"
        self._faults.touch()
        self.starved: list[str] = []
        """Actors that the kernel has killed because a cgroup had no memory left."""

    def __enter__(self) -> Self:
        self._line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._line.settimeout(PATIENCE_S)
        with theirs, (self.folder / "zygote.log").open("wb") as errors:
            number = theirs.fileno()
            self._process = subprocess.Popen(
                [sys.executable, "-m", "chaos.actor", str(number)],
                pass_fds=[number],
                stderr=errors,
                cwd=self.folder,
                env=self._environment,
                start_new_session=True,  # a Ctrl-C is for the director, which then ends them
            )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for name in tuple(self.actors):
            self.kill(name)
        self._line.close()
        self._process.wait(PATIENCE_S)

    def enter(self, role: Role) -> Actor:
        if role.cgroup_bytes:
            role = replace(role, cgroup=str(cgroup.make(role.name, role.cgroup_bytes)))
        ours, theirs = socket.socketpair()
        ours.settimeout(PATIENCE_S)
        with theirs, _uninterrupted():
            socket.send_fds(self._line, [msgspec.json.encode(role)], [theirs.fileno()])
            actor = self.actors[role.name] = Actor(role, int(self._line.recv(64)), ours)
        return actor

    def kill(self, name: str) -> int:
        """Kill it; returns the status, which differs if it had ended before."""
        self.actors[name].signal(signal.SIGKILL)
        return self.reap(name)

    def leave(self, name: str) -> int:
        """Let it end in order; returns the status."""
        self.actors[name].leave()
        return self.reap(name)

    def reap(self, name: str) -> int:
        actor = self.actors.pop(name)
        self._line.send(b"%d" % actor.pid)
        status = int(self._line.recv(64))
        actor.close()
        if actor.role.cgroup:
            place = Path(actor.role.cgroup)
            if kills := cgroup.kills(place):
                self.starved.append(
                    f"{name}: {kills} killed where {actor.role.cgroup_bytes >> 20} MiB are all"
                )
            cgroup.remove(place)
        return status

    def published(self, talker: int) -> tuple[int, int]:
        """How many messages a talker, living or dead, has published, at least and at most."""
        try:
            noted = (self.folder / f"{talker}.ledger").read_bytes()
        except FileNotFoundError:
            return 0, 0
        begun, done = (
            int.from_bytes(noted[place * WORD_BYTES :][:WORD_BYTES], "little") for place in (BEGUN, DONE)
        )
        return done, max(begun, done)

    def note(self, what: str) -> None:
        """Note an event with its time, for people who look for a cause."""
        with (self.folder / "deeds").open("a") as deeds:
            deeds.write(f"{time.time():.3f} {what[:300]}\n")

    def faults(self) -> list[str]:
        """Forbidden events that actors reported."""
        return self._faults.read_text().splitlines()

    def last_lines(self, name: str, number: int = 12) -> list[str]:
        try:
            return (self.folder / f"{name}.log").read_text(errors="replace").splitlines()[-number:]
        except FileNotFoundError:
            return []
