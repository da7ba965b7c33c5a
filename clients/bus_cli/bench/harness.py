"""Child processes of one measurement: their start, their events, and their end in every case.

A child writes JSON objects with an `event` to its stdout, one on each line. It obeys words, which are lines
on its stdin, and ends when its stdin ends. A child only ends by itself if it is started with `ends`. The
measurement is a `Failure` if a child ends too early, ends with a status other than 0, or is silent for too
long.
"""

import json
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from time import clock_gettime_ns, monotonic
from types import TracebackType
from typing import Any, Self

from bus.link.autostart import BUSD
from bus.process.address import MAX_PATH_BYTES
from bus_cli.bench.interrupts import deferred
from bus_cli.output import CommandError

__all__ = ["START_S", "STOP_S", "Child", "Event", "Failure", "Group"]

START_S = 20.0
"""Longer than the start of any process on a busy machine."""
STOP_S = 5.0
_READ_BYTES = 1 << 20
_CPUCLOCK_SCHED = 2
_TAIL_BYTES = 40
"""Room for the part of a socket's path that follows the folder for temporary files."""


class Failure(CommandError):
    """A measurement failed; the text has the reason."""


class Event(dict[str, Any]):
    """An event of a child. Access to a missing value raises Failure."""

    def __missing__(self, key: str) -> Any:
        raise Failure(f"the event {self.get('event')!r} came without {key!r}")


class Child:
    """A process of a `Group`, made by `Group.start`."""

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        environ: Mapping[str, str],
        folder: Path,
        cwd: Path | None,
        stop_signal: signal.Signals | None,
        ends: bool,
    ) -> None:
        self.name = name
        self.ends = ends
        self.events: list[Event] = []
        self.is_server = stop_signal is not None
        self._stop_signal = stop_signal
        self._log = folder / f"{name}.log"
        self._cwd = cwd
        self.has_closed_stdout = False
        self._rest = bytearray()
        with self._log.open("wb") as log:
            # With a new session, Ctrl-C in the terminal only reaches this process. It ends the others in
            # order.
            self._process = subprocess.Popen(
                command,
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                env=environ,
                cwd=cwd,
                start_new_session=True,
            )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._stdin = self._process.stdin.fileno()
        self.stdout = self._process.stdout.fileno()
        self.pid = self._process.pid
        self.exit_fd = os.pidfd_open(self.pid)

    def send(self, word: str) -> None:
        """Send `word`. If the child is gone, the wait for its answer detects it."""
        try:
            os.write(self._stdin, word.encode() + b"\n")
        except BrokenPipeError:
            pass

    def cpu_ns(self) -> int:
        """CPU time of all its threads so far, in ns and not in ticks. Raises Failure if the child is gone."""
        try:
            # The kernel's number for the CPU clock of a process; see clock_getcpuclockid(3).
            return clock_gettime_ns((~self.pid << 3) | _CPUCLOCK_SCHED)
        except OSError:
            raise Failure(self.describe_end()) from None

    def read(self) -> None:
        """Read its output so far, without waiting."""
        data = os.read(self.stdout, _READ_BYTES)
        self.has_closed_stdout = not data
        self._rest += data
        if b"\n" not in data:
            return  # part of a long line: split only complete lines
        *lines, self._rest = self._rest.split(b"\n")
        for line in map(bytes, lines):
            if not line.startswith(b"{"):
                continue  # output for people
            try:
                self.events.append(Event(json.loads(line)))
            except ValueError:
                raise Failure(f"{self.name} printed a line that is not JSON: {line[:80]!r}") from None

    def take(self, event: str) -> Event | None:
        """Remove and return the oldest event of that name, or None."""
        for index, one in enumerate(self.events):
            if one.get("event") == event:
                return self.events.pop(index)
        return None

    def is_running(self) -> bool:
        """Whether it still runs. Raises Failure if it ended too early or with an error."""
        status = self._process.poll()
        if status is None or (status == 0 and self.ends):
            return status is None
        raise Failure(self.describe_end())

    def describe_end(self) -> str:
        """Text about its end, with its last line on stderr."""
        try:
            status = self._process.wait(timeout=STOP_S)
        except subprocess.TimeoutExpired:
            return f"{self.name} is ending"
        how = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"exited with {status}"
        lines = self._log.read_text(errors="replace").strip().splitlines()
        last = lines[-1] if lines else ""
        if self._cwd is not None:  # results are published and must not contain paths of this machine
            last = last.replace(str(self._log.parent), "<folder>").replace(str(self._cwd), ".")
        return f"{self.name} {how}" + (f": {last}" if last else "")

    def ask_to_end(self) -> None:
        """Close its stdin. If it has a stop signal, send that, too."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        if self._stop_signal is not None:
            self._process.send_signal(self._stop_signal)

    def end(self, deadline: float) -> None:
        """Reap it; kill it if it still runs at `deadline` (of the monotonic clock)."""
        try:
            self._process.wait(timeout=max(0.0, deadline - monotonic()))
        except subprocess.TimeoutExpired:
            pass
        finally:
            self._process.kill()
            self._process.wait()
            os.close(self.exit_fd)
            assert self._process.stdin is not None and self._process.stdout is not None
            self._process.stdin.close()
            self._process.stdout.close()


class Group:
    """All processes of one measurement, and a temporary folder for them.

    They run in `cwd`, or in the current folder if that is None. `busd` is the command to start a busd. The
    end of the `with` block ends the processes in the reverse order of their start, also after an exception.
    """

    def __init__(self, cwd: Path | None = None, busd: Sequence[str] = BUSD) -> None:
        self._folder = TemporaryDirectory(prefix="busd-bench-", dir=_short_folder())
        self._cwd = cwd
        self._busd = busd
        self.folder = Path(self._folder.name)
        self.environ = {**os.environ, "BUSD_AUTOSTART": "0"}
        self.environ.pop("NOTIFY_SOCKET", None)
        self._children: list[Child] = []

    def start(
        self,
        name: str,
        *command: str,
        environ: Mapping[str, str] | None = None,
        stop_signal: signal.Signals | None = None,
        ends: bool = False,
    ) -> Child:
        """Start `command`. It `ends` by itself, or ends at `stop_signal`, or at the end of its stdin."""
        with deferred():
            environ = {**self.environ, **(environ or {})}
            child = Child(name, command, environ, self.folder, self._cwd, stop_signal, ends)
            self._children.append(child)
        return child

    def start_python(self, name: str, *arguments: str) -> Child:
        """Start a Python program that uses the protocol of this module."""
        return self.start(name, sys.executable, *arguments)

    def expect(self, child: Child, event: str, *, within_s: float) -> Event:
        """Wait for the next `event` of `child`. Raises Failure if it does not come, or if any child ends."""
        deadline = monotonic() + within_s
        while True:
            found = child.take(event)
            if found is not None:
                return found
            self.wait_for_news(deadline, f"{child.name} did not say {event!r} within {within_s:g} s")

    def wait(self, child: Child, *, within_s: float) -> None:
        """Wait for the end of a child started with `ends`. Raises Failure like `expect`."""
        deadline = monotonic() + within_s
        while child.is_running():
            self.wait_for_news(deadline, f"{child.name} did not end within {within_s:g} s", child.exit_fd)

    def kill(self, child: Child) -> None:
        """Kill a child like a crash, and reap it."""
        os.kill(child.pid, signal.SIGKILL)
        self.let_go(child)

    def let_go(self, child: Child) -> None:
        """Reap a child that has ended before the others."""
        self._children.remove(child)
        child.end(monotonic())

    def start_busd(self, program: str = "", *more: str, name: str = "busd") -> Child:
        """Start a busd and return when it listens. Children started later use it.

        `program`: busd's program in another checkout. `more`: its arguments. `name`: the name of the child
        and of its socket.
        """
        path, notify = self.folder / f"{name}.sock", self.folder / "ready"
        self.environ["BUSD_SOCKET"] = str(path)
        notify.unlink(missing_ok=True)  # a killed busd may have left it
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ready:
            ready.bind(str(notify))
            ready.setblocking(False)
            # If this process is killed, busd ends by itself after its last client.
            child = self.start(
                name,
                *((program,) if program else self._busd),
                *("--log-level", "warn", "--idle-exit", str(START_S)),
                *more,
                environ={"NOTIFY_SOCKET": str(notify)},
                stop_signal=signal.SIGTERM,
            )
            deadline = monotonic() + START_S
            while True:
                try:
                    ready.recv(4096)
                    return child
                except BlockingIOError:
                    self.wait_for_news(deadline, f"busd is not ready after {START_S:g} s", ready.fileno())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        grace_s = STOP_S if error is None else STOP_S / 5
        try:
            for child in self._children:
                if not child.is_server:
                    child.ask_to_end()
        finally:
            self._reap(grace_s)

    def _reap(self, grace_s: float) -> None:
        deadline = monotonic() + grace_s
        try:
            while self._children:
                child = self._children.pop()
                try:
                    # Servers end last, because children need them, and have a separate time limit.
                    if child.is_server:
                        child.ask_to_end()
                        deadline = monotonic() + grace_s
                finally:
                    child.end(deadline)
        except BaseException:
            # A second interruption ends all at once.
            self._reap(0.0)
            raise
        finally:
            self._folder.cleanup()

    def wait_for_news(self, deadline: float, complaint: str, *others: int) -> None:
        """Wait until a child writes or ends, or until one of the `others` (descriptors) is readable.

        Raises Failure with `complaint` at `deadline` (of the monotonic clock), or if a child has ended too
        early or with an error.
        """
        running = [child for child in self._children if child.is_running()]
        writers = {child.stdout: child for child in self._children if not child.has_closed_stdout}
        enders = {child.exit_fd: child for child in running}
        poller = select.poll()
        for fd in (*others, *writers, *enders):
            poller.register(fd, select.POLLIN)
        ready = [fd for fd, _ in poller.poll(max(0.0, deadline - monotonic()) * 1000)]
        if not ready:
            raise Failure(complaint)
        for fd in ready:
            if fd in writers:
                writers[fd].read()
        for fd in ready:
            if fd in enders:
                enders[fd].is_running()


def _short_folder() -> str:
    """The folder for temporary files; /tmp if its path is too long for a socket below it."""
    folder = gettempdir()
    return folder if len(os.fsencode(folder)) < MAX_PATH_BYTES - _TAIL_BYTES else "/tmp"
