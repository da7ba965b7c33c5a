"""Python programs as forks of a process with all needed imports: a start costs 20 ms, not 400.

    forks = Forks()                      one for all tests of a process
    forks.run(["-m", "busd"], stderr=…)  a `Fork`, used like a subprocess.Popen

Each program is a separate process, with its command line, environment and folder, and it ends as any other.
But no interpreter starts. A test of imports, or of inherited state (limits, ignored signals), must start a
real one.
"""

import atexit
import gc
import importlib
import io
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Self

import msgspec

from process_title import set_title
from zygote import serve

_IMPORTED = ("asyncio", "uvloop", "msgspec", "shutil", "busd.run", "bus.wire.messages")


_HEEDED = ("PYTHONASYNCIODEBUG", "PYTHONUNBUFFERED")


def _for_interpreter(environment: Mapping[str, str]) -> dict[str, str]:
    """Variables that an interpreter reads only when it starts."""
    return {
        name: value
        for name, value in environment.items()
        if name.startswith("PYTHON") and name not in _HEEDED
    }


class Order(msgspec.Struct):
    """A program to run; its descriptors are stdin, stdout and stderr."""

    words: list[str]
    environment: dict[str, str]
    folder: str
    leads_session: bool
    is_finalized: bool


class Fork:
    """A forked process; only the zygote knows its status."""

    def __init__(self, pid: int, ask: Callable[[bytes], int], words: list[str]) -> None:
        self.pid = pid
        self.args = [sys.executable, *words]
        self.returncode: int | None = None
        self._ask = ask
        self._descriptor = os.pidfd_open(pid)

    def poll(self) -> int | None:
        return self._look(0)

    def wait(self, timeout: float | None = None) -> int:
        status = self._look(timeout)
        if status is None:
            raise subprocess.TimeoutExpired(self.args, timeout or 0)
        return status

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)  # the pid is not reused before its status was read

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def _look(self, timeout_s: float | None) -> int | None:
        if self.returncode is None:
            poll = select.poll()
            poll.register(self._descriptor, select.POLLIN)
            if poll.poll(None if timeout_s is None else timeout_s * 1000):
                os.close(self._descriptor)
                self.returncode = self._ask(b"%d" % self.pid)
        return self.returncode


class Forks:
    """The process that forks, started with the first program; closing kills remaining programs."""

    def __init__(self, imports: Sequence[str] = _IMPORTED) -> None:
        self._imports = imports
        self._line, self._theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._variables = _for_interpreter(os.environ)
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None

    def can_run(self, environment: Mapping[str, str] = os.environ) -> bool:
        """Whether an interpreter started now would be like the forking one."""
        return _for_interpreter(environment) == self._variables

    def run(
        self,
        words: Sequence[str],
        *,
        stdin: int = -1,
        stdout: int = -1,
        stderr: int = -1,
        environment: Mapping[str, str] = os.environ,
        leads_session: bool = False,
        is_finalized: bool | None = None,
    ) -> Fork:
        """Begin a program in the folder of this process; -1: the stream is /dev/null.

        Without `is_finalized`, a program that ends with status 0 skips Python's finalization of modules. The
        finalization touches, and so copies, all memory shared with the fork: a third of the processor time of
        a busd. None: finalized in `make nightly` only.
        """
        if is_finalized is None:
            from effort import is_nightly  # here, because the forking process must not load hypothesis

            is_finalized = is_nightly()
        order = Order(list(words), dict(environment), str(Path.cwd()), leads_session, is_finalized)
        nothing = os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)
        try:
            streams = [nothing if number < 0 else number for number in (stdin, stdout, stderr)]
            pid = self._ask(msgspec.json.encode(order), streams)
        finally:
            os.close(nothing)
        return Fork(pid, self._ask, order.words)

    def _ask(self, order: bytes, streams: Sequence[int] = ()) -> int:
        with self._lock:
            if self._process is None:
                self._process = self._start()
            socket.send_fds(self._line, [order], streams)
            return int(self._line.recv(64))

    def _start(self) -> subprocess.Popen[bytes]:
        with self._theirs:
            number = self._theirs.fileno()
            command = [sys.executable, __file__, str(number), *self._imports]
            return subprocess.Popen(command, pass_fds=[number])

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._line.close()
        self._theirs.close()
        if self._process is not None:
            self._process.wait()


def _become(order: Order, descriptors: list[int]) -> Order:
    """Turn this process, just forked, into that program, up to its first line."""
    if order.leads_session:
        os.setsid()
    for number, descriptor in enumerate(descriptors):
        os.dup2(descriptor, number)
    os.closerange(3, max(descriptors) + 1)
    os.chdir(order.folder)
    os.environ.clear()
    os.environ.update(order.environment)
    sys.orig_argv[:] = command = [sys.executable, *order.words]
    if not set_title(command, order.environment):
        os.execve(command[0], command, order.environment)
    sys.stdin, sys.stdout, sys.stderr = _stream(0, "r"), _stream(1, "w"), _stream(2, "w")
    return order


def _stream(number: int, mode: str) -> io.TextIOWrapper:
    """A standard stream as the interpreter makes it (sys.stdin and so on)."""
    is_at_once = mode == "w" and bool(os.environ.get("PYTHONUNBUFFERED"))
    raw = io.FileIO(number, mode, closefd=False)
    buffered = raw if is_at_once else (io.BufferedReader if mode == "r" else io.BufferedWriter)(raw)
    return io.TextIOWrapper(
        buffered,
        errors="backslashreplace" if number == 2 else "strict",
        line_buffering=number == 2 or raw.isatty(),
        write_through=is_at_once,
    )


def _run(words: list[str]) -> None:
    kind, *rest = words
    if kind == "-m":
        sys.path[0] = str(Path.cwd())
        sys.argv[:] = rest
        runpy.run_module(rest[0], run_name="__main__", alter_sys=True)
    elif kind == "-c":
        sys.path[0] = ""
        sys.argv[:] = ["-c", *rest[1:]]
        main = sys.modules["__main__"] = ModuleType("__main__")
        exec(compile(rest[0], "<string>", "exec"), main.__dict__)
    else:
        sys.path[0] = str(Path(kind).resolve().parent)
        sys.argv[:] = words
        runpy.run_path(kind, run_name="__main__")


def _end(code: object) -> None:
    """End this process as Python does, but without the finalization.

    Python handles a failure: a program may end by a signal then, within the finalization.
    """
    if not code:
        threading._shutdown()  # type: ignore[attr-defined]  # waits for the threads that are no daemons
        atexit._run_exitfuncs()
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(0)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a Ctrl-C at the tests is only for them
    for name in sys.argv[2:]:
        importlib.import_module(name)
    gc.collect()
    gc.freeze()
    if order := serve(int(sys.argv[1]), Order, _become):
        signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            _run(order.words)
        except SystemExit as end:
            if not order.is_finalized:
                _end(end.code)
            raise
        if not order.is_finalized:
            _end(None)
