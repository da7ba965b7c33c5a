"""Other users, for tests of access; only root can act as them.

    with acting_as(GUEST):
        peer = RawPeer(path)            a connection made here belongs to that user for the kernel
    program(GUEST, source, "argument")  a process of that user, without any of root's rights

The users have unused numbers. `Guests` is a busd that belongs to one of them, with rules for others.
"""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import IO, Self

import pytest

from conftest import WAIT_S

OWNER, GUEST, STRANGER = 54321, 54322, 54323
TEAM = 54400
"""A group."""


@cache
def why_not() -> str:
    """The reason why other users are impossible here; "" if they are possible."""
    if os.geteuid() != 0:
        return "only root can be another user"
    if shutil.which("setpriv") is None:
        return "setpriv is not installed"
    return "" if _can_run(()) or _can_run(_READING) else "other users can't run this Python"


def command(uid: int, *arguments: str, groups: tuple[int, ...] = ()) -> list[str]:
    """Python with these arguments, as that user."""
    return _command(uid, arguments, groups, () if _can_run(()) else _READING)


_READING = ("--inh-caps=+dac_read_search", "--ambient-caps=+dac_read_search")
"""For a Python in a folder of root's: another user may then read all files, but write none."""


@cache
def _can_run(privileges: tuple[str, ...]) -> bool:
    started = _command(GUEST, ("-c", "import bus, busd"), (), privileges)
    return not subprocess.run(
        started, env=_environment(), cwd="/", capture_output=True, check=False
    ).returncode


def _command(
    uid: int, arguments: tuple[str, ...], groups: tuple[int, ...], privileges: tuple[str, ...]
) -> list[str]:
    others = f"--groups={','.join(map(str, groups))}" if groups else "--clear-groups"
    return ["setpriv", f"--reuid={uid}", f"--regid={uid}", others, *privileges, sys.executable, *arguments]


def _environment() -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if name != "XDG_RUNTIME_DIR"}
    return {**kept, "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path)), "HOME": "/"}


@contextlib.contextmanager
def acting_as(uid: int, *groups: int) -> Iterator[None]:
    """In the block, this process's files and connections belong to that user. Other threads should idle."""
    before = os.getgroups()
    os.setgroups(groups)
    os.setegid(uid)
    os.seteuid(uid)
    try:
        yield
    finally:
        os.seteuid(0)
        os.setegid(0)
        os.setgroups(before)


def program(
    uid: int,
    source: str,
    *arguments: str,
    groups: tuple[int, ...] = (),
    stdin: int = subprocess.PIPE,
    **environment: str,
) -> subprocess.Popen[str]:
    """A Python program of that user; the caller ends it, or waits for it."""
    return subprocess.Popen(
        command(uid, "-c", source, *arguments, groups=groups),
        env={**_environment(), **environment},
        cwd="/",
        stdin=stdin,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


@contextlib.contextmanager
def running(process: subprocess.Popen[str]) -> Iterator[tuple[IO[str], IO[str]]]:
    """The output and the input of the program; it is killed at the end, if it still runs."""
    assert process.stdout is not None and process.stdin is not None
    with process:
        try:
            yield process.stdout, process.stdin
        finally:
            process.kill()


def output_of(process: subprocess.Popen[str]) -> str:
    """All output of a program until its end; it is killed if that takes too long."""
    with process:
        try:
            return process.communicate(timeout=WAIT_S)[0]
        except subprocess.TimeoutExpired:
            process.kill()
            raise


class Guests:
    """A busd of the user OWNER in a folder that others can enter. `rules` is the text of its busd.toml."""

    def __init__(self, rules: str, *, socket: str = "mode = 0o666") -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="busd-users-"))
        self.folder.chmod(0o755)
        os.chown(self.folder, OWNER, OWNER)
        self.path = self.folder / "0.sock"
        self._config = self.folder / "busd.toml"
        self._log = self.folder / "log"
        self._socket = socket
        self.write(rules)
        try:
            self.process = self._start()
        except BaseException:
            shutil.rmtree(self.folder)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.process.terminate()
        self.process.wait(WAIT_S)
        log = self.log
        shutil.rmtree(self.folder)
        if error is None:
            assert "Traceback" not in log, log
            assert self.process.returncode == 0, log

    @property
    def log(self) -> str:
        return self._log.read_text()

    def door(self, uid: int) -> Path:
        """Another path to the same socket."""
        path = self.folder / f"user-{uid}.sock"
        if not path.is_symlink():
            path.symlink_to(self.path)
        return path

    def write(self, rules: str) -> None:
        """Write other rules, for the next start or `reload`."""
        self._config.write_text(f"[socket]\n{self._socket}\n{rules}")

    def reload(self, rules: str) -> None:
        """Apply other rules."""
        self.write(rules)
        reloads = self.log.count("] [busd]: reloaded ")
        self.process.send_signal(signal.SIGHUP)
        self.wait_for_log(lambda log: log.count("reloaded ") > reloads)

    def wait_for_log(self, condition: "object") -> None:
        """Wait until the log fits `condition`: a text that is in it, or a function of it."""
        end = time.monotonic() + WAIT_S
        while not (condition in self.log if isinstance(condition, str) else condition(self.log)):  # type: ignore[operator]
            assert time.monotonic() < end, self.log
            time.sleep(0.005)

    def _start(self) -> subprocess.Popen[bytes]:
        paths = ("--socket", str(self.path), "--config", str(self._config))
        with self._log.open("ab") as log:
            process = subprocess.Popen(
                command(OWNER, "-m", "busd", *paths, groups=(TEAM,)),
                env=_environment(),
                cwd="/",
                stderr=log,
            )
        end = time.monotonic() + WAIT_S
        while "listening on" not in self.log:
            if process.poll() is not None or time.monotonic() > end:
                process.kill()
                process.wait()
                raise RuntimeError(f"busd did not start: {self.log}")
            time.sleep(0.005)
        return process


def rule(users: str, topics: str, *actions: str, more: str = "") -> str:
    """One [[access]] of a busd.toml; `users` as TOML, with the key."""
    listed = ", ".join(f'"{action}"' for action in actions)
    return f'[[access]]\n{users}\ntopics = "{topics}"\nactions = [{listed}]\n{more}\n'


needs_users = pytest.mark.skipif(bool(why_not()), reason=why_not() or "never")
