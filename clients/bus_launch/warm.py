"""Nodes in Python, forked from one process that has imported busd's rclpy: a sixth of the work of a start.

Owns: the choice of programs, that process, and a node's surroundings, which look like a new process's. Must
not know: events, output. The launch's side is `fork`; the process is `python -m bus_launch.warm FD`.

The process between that process and a node ends at once, so the node becomes a child of the launch. If
anything fails, no node runs, and the launch starts it as it starts other programs.
"""

# pathlib would add milliseconds to the start:
# ruff: noqa: PTH123
import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from io import TextIOWrapper
from typing import Final, cast

__all__ = ["START", "Forked", "end", "fork"]

START: Final = (sys.executable, "-m", "bus_launch.python_program")
"""The words that the command of a program in Python begins with."""

_PATIENCE_S: Final = 10.0
_LONGEST: Final = 1 << 16
_READY: Final = b"."
_PR_SET_CHILD_SUBREAPER: Final = 36
_PR_SET_MM: Final = 35
_PR_SET_MM_MAP: Final = 14
_NO_FILE: Final = 0xFFFFFFFF


class Forked:
    """A node: as much of a subprocess.Popen as a launch needs."""

    def __init__(self, pid: int, stdin: int) -> None:
        self.pid = pid
        self.stdin = open(stdin, "wb", buffering=0)  # noqa: SIM115 (the waiting code closes it)

    def wait(self) -> int:
        return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])


def fork(command: Sequence[str], env: Mapping[str, str] | None, stdout: int, stderr: int) -> Forked | None:
    """Start a node, in its own process group; None if the launch must start it as any other program.

    This is so for other programs, for the first node of a launch, and for nodes whose environment or current
    folder differs from the second node's.
    """
    global _warm
    if tuple(command[: len(START)]) != START:
        return None
    with _lock:
        if _warm is None:
            _warm = _Warm()
            return None
        return _warm.fork(command, dict(os.environ if env is None else env), (stdout, stderr))


def end() -> None:
    """End the process that nodes are forked from; the nodes go on."""
    global _warm
    with _lock:
        if _warm is not None:
            _warm.end()
            _warm = None


class _Warm:
    """The launch's side of the process that nodes are forked from. Its first `fork` starts it."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._socket: socket.socket | None = None
        self._made_for: tuple[str, dict[str, str]] | None = None

    def fork(self, command: Sequence[str], env: dict[str, str], outputs: tuple[int, int]) -> Forked | None:
        try:
            here = os.getcwd()  # noqa: PTH109
            if self._made_for is None:
                self._made_for = (here, env)
                self._start(env)
            message = json.dumps(command).encode()
            if self._socket is None or self._made_for != (here, env) or len(message) > _LONGEST:
                return None
            return self._ask(self._socket, message, outputs)
        except (OSError, ValueError):  # no pid: it could not be forked
            self.end()
            return None

    def _ask(self, warm: socket.socket, message: bytes, outputs: tuple[int, int]) -> Forked:
        stdin, ours = os.pipe()
        try:
            talk, other = socket.socketpair()
            with talk:
                talk.settimeout(_PATIENCE_S)
                _adopt(True)  # before it is asked for: its parent may be gone at once
                try:
                    with other:
                        socket.send_fds(warm, [message], [stdin, *outputs, other.fileno()])
                    pid = int(talk.recv(16))
                    ready = warm.recv(1)
                finally:
                    _adopt(False)
                if ready != _READY:
                    raise BrokenPipeError
                talk.send(_READY)
            return Forked(pid, ours)
        except BaseException:
            os.close(ours)
            raise
        finally:
            os.close(stdin)

    def _start(self, env: dict[str, str]) -> None:
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.settimeout(_PATIENCE_S)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "bus_launch.warm", str(theirs.fileno())],
                env=env,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,  # a normally started node will report any fault of this Python
                pass_fds=[theirs.fileno()],
                process_group=0,
            )
        if self._socket.recv(1) != _READY:
            raise BrokenPipeError

    def end(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


_warm: _Warm | None = None
_lock: Final = threading.Lock()


def _adopt(is_on: bool) -> None:
    """Set whether orphaned processes become children of this process."""
    import ctypes

    if ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, int(is_on), 0, 0, 0):
        raise OSError("no subreaper")


# --- the process that nodes are forked from

_kept: Final[list[object]] = []
"""The command line that the kernel shows."""


def _become_node() -> None:
    """Serve the launch; returns in each node's process."""
    import gc

    launch = socket.socket(fileno=int(sys.argv[1]))
    os.set_inheritable(launch.fileno(), False)
    _import_all()
    gc.collect()
    gc.freeze()  # or each node would copy all pages when it first collects
    launch.send(_READY)
    while True:
        message, fds, _, _ = socket.recv_fds(launch, _LONGEST, 4)
        if not message:
            os._exit(0)
        if between := os.fork():
            os.waitpid(between, 0)
            for fd in fds:
                os.close(fd)
            launch.send(_READY)
            continue
        node = os.fork()
        talk = socket.socket(fileno=fds[3])
        if node:
            os.setpgid(node, node)
            talk.send(str(node).encode())
            os._exit(0)
        launch.close()
        with talk:
            if talk.recv(1) != _READY:
                os._exit(0)  # the launch starts it in another way
        for number, fd in enumerate(fds[:3]):
            os.dup2(fd, number)
            os.close(fd)
        stdout = cast(TextIOWrapper, sys.stdout)
        if os.isatty(1) and not stdout.write_through:  # Python looks once, when it starts
            stdout.reconfigure(line_buffering=True)
        return _dress(json.loads(message))


def _import_all() -> None:
    """Import the modules that each node needs.

    A node finds `rclpy` and messages itself, along its own path.
    """
    from importlib import import_module

    here, *sys.path[:] = sys.path  # a program's folder comes first, never the current one
    for name in (
        *("ctypes", "mmap", "struct"),
        "bus.msg.rcl_interfaces",
        "bus.process.logfile",
        "bus.shm",
        "bus.types.classes",
        "bus_launch.python_program",
        "bus_ros.rclpy",
        "bus_ros.rclpy.parameter_service",
        "bus_ros.rosidl.support",
        "bus_ros.rosidl.wire",
    ):
        import_module(name)
    sys.path.insert(0, here)


def _dress(command: list[str]) -> None:
    """Have this process look as if it had been started by `command`; some kernels keep what `ps` shows."""
    import ctypes
    import mmap
    import struct

    sys.orig_argv[:] = command
    sys.argv[:] = ["-m", *command[len(START) :]]
    text = b"".join(os.fsencode(word) + b"\0" for word in command)
    block = mmap.mmap(-1, len(text), flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    block.write(text)
    start = ctypes.addressof(ctypes.c_char.from_buffer(block))
    _kept.append(block)
    libc = ctypes.CDLL(None)
    libc.sbrk.restype = ctypes.c_void_p
    with open("/proc/self/stat", "rb") as file:
        stat = file.read().rpartition(b")")[2].split()
    # The kernel's struct prctl_mm_map, by the numbers of proc(5): code, data, break, stack, environ.
    places = [int(stat[number - 3]) for number in (26, 27, 45, 46, 47, 28, 50, 51)]
    places[5:5] = [libc.sbrk(ctypes.c_long(0))]
    places[7:7] = [start, start + len(text)]
    new = struct.pack("=12QII", *places, 0, 0, _NO_FILE)
    libc.prctl(_PR_SET_MM, _PR_SET_MM_MAP, new, ctypes.c_ulong(len(new)), 0)


if __name__ == "__main__":
    try:
        _become_node()
        from bus_launch.python_program import main

        main()
    except KeyboardInterrupt:
        from bus.process.termination import say_nothing_of_signals

        say_nothing_of_signals()
        raise
