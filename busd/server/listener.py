"""The listening UNIX socket: opened by us or by a service manager, and ours alone while we live.

Owns the socket file, its folder and the lock that settles which daemon serves a path. Must not know the
messages on the connections.

Invariants:
- A process holds an exclusive flock on "<path>.lock" while it binds, replaces or removes the socket file. The
  kernel ends the lock with the process, however that dies. So a file at the path belongs to a dead daemon
  once we hold the lock.
- A lock file counts only while it is the one at its path: its holder removes it at the end. A process that
  gets the flock afterwards looks whether the file is still there, and begins again if not.
- A folder in which other users than this one and root could replace our files is refused.
"""

import errno
import fcntl
import os
import socket
import stat
from collections.abc import MutableMapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from bus.errors import ConfigurationError
from bus.link.socket_owner import prepare_folder
from bus.process.address import is_default_folder, socket_path
from busd.server.credentials import peer_credentials, process_name

__all__ = ["BACKLOG", "AlreadyRunning", "Listener", "open_listener"]

BACKLOG = 512
"""Connections that may wait to be accepted. asyncio listens again with its own, smaller number: pass this."""

_LOCK_ATTEMPTS = 100
_ACTIVATED_FD = 3  # SD_LISTEN_FDS_START, sd_listen_fds(3)
_ACTIVATION = ("LISTEN_PID", "LISTEN_FDS", "LISTEN_FDNAMES", "LISTEN_PIDFDID")
_HANDOVER = "BUSD_HANDOVER"
"""Environment variable for the program that this process runs next: pid, socket and lock, as "4711 5 6"."""


class AlreadyRunning(ConfigurationError):
    """Another process serves this path; `pid` is None if it can't be found out."""

    def __init__(self, path: Path, pid: int | None, *, program: str = "busd") -> None:
        suffix = f" (pid {pid})" if pid else ""
        super().__init__(f"{program} is already running on {path}{suffix}")
        self.path = path
        self.pid = pid


class SocketRights(Protocol):
    """The users that can reach the socket beside this one."""

    @property
    def mode(self) -> int:
        """Mode of the socket's file."""

    @property
    def group(self) -> str | int | None:
        """The file's group, as errors name it."""

    @property
    def gid(self) -> int | None:
        """The group's number, or None if the socket keeps the process's group."""


class Listener:
    """A listening, non-blocking UNIX stream socket. Close it, or use it as a context manager."""

    def __init__(self, listening: socket.socket, path: Path, lock: "_Lock | None" = None) -> None:
        self.socket = listening
        self.path = path
        self.activated = lock is None
        """Whether a service manager opened the socket: then its file is not ours to remove."""
        self._lock = lock
        self._file = None if lock is None else _identity(path.lstat())

    def close(self) -> None:
        """Close the socket, remove its file if it is still ours, and let the next daemon in. Idempotent."""
        if self._lock is not None:
            try:
                if _identity(self.path.lstat()) == self._file:
                    self.path.unlink()
            except OSError:
                pass  # it or its folder was removed already: nothing is left behind
        self.socket.close()
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def let_in(self, rights: SocketRights | None) -> None:
        """Set the socket's mode and group, if busd may set them; existing connections stay.

        Raises ConfigurationError if that is not permitted.
        """
        if self._lock is not None:
            try:
                _let_in(self.path, rights)
            except OSError as error:
                raise ConfigurationError(f"can't set the mode of '{self.path}': {error.strerror}") from None

    def bequeath(self) -> dict[str, str]:
        """Leave the socket and the lock to the program that this process runs next.

        Returns the variables that its environment needs for its `open_listener` to find them.
        """
        kept = [self.socket.fileno()] if self._lock is None else [self.socket.fileno(), self._lock.fileno()]
        for descriptor in kept:
            os.set_inheritable(descriptor, True)
        if self._lock is None:
            return {"LISTEN_PID": str(os.getpid()), "LISTEN_FDS": "1"}
        return {_HANDOVER: " ".join(map(str, [os.getpid(), *kept]))}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def open_listener(
    path: Path | None = None,
    *,
    rights: SocketRights | None = None,
    environ: MutableMapping[str, str] = os.environ,
) -> Listener:
    """Listen on the socket that a service manager passed, else at `path`, else where `socket_path` says.

    First of all counts the socket that the program before this one, in the same process, has left
    (`Listener.bequeath`). The variables that say so are removed from `environ`; else a child could take them
    for its own. A missing folder is made if it is the default one; any other must exist. `rights`: of others,
    by default none; a socket that a service manager passed stays as it is.

    Raises AlreadyRunning if another process serves the path, and ConfigurationError, which says why, if the
    socket or its folder can't be used or can't be trusted.
    """
    activated = _activated(environ)
    if activated is not None:
        return activated
    path = socket_path(environ=environ) if path is None else path
    inherited = _inherited(path, environ)
    if inherited is not None:
        inherited.let_in(rights)
        return inherited
    prepare_folder(
        path.parent, is_default=is_default_folder(path.parent, environ), may_enter=_may_enter(rights)
    )
    lock = _Lock(path)
    try:
        return Listener(_bind(path, rights), path, lock)
    except BaseException:
        lock.release()
        raise


def _activated(environ: MutableMapping[str, str]) -> Listener | None:
    pid, count, *_ = [environ.pop(name, "") for name in _ACTIVATION]
    if pid != str(os.getpid()) or count == "0":
        return None
    if count != "1":
        raise ConfigurationError(f"LISTEN_FDS={count}: busd takes one socket")
    try:
        os.set_inheritable(_ACTIVATED_FD, False)
        listening = socket.socket(fileno=_ACTIVATED_FD)
        is_listening = listening.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)
    except OSError as error:
        raise ConfigurationError(f"descriptor {_ACTIVATED_FD} of LISTEN_FDS: {error.strerror}") from None
    if listening.family != socket.AF_UNIX or listening.type != socket.SOCK_STREAM or not is_listening:
        listening.close()
        raise ConfigurationError("LISTEN_FDS: busd needs a listening UNIX stream socket (ListenStream=/...)")
    listening.setblocking(False)
    name = os.fsdecode(listening.getsockname())
    return Listener(listening, Path(name.replace("\0", "@", 1)))


def _inherited(path: Path, environ: MutableMapping[str, str]) -> Listener | None:
    """The bequeathed socket, if it is for `path` and still in place; otherwise busd makes a new one."""
    pid, *numbers = environ.pop(_HANDOVER, "").split() or [""]
    if pid != str(os.getpid()):
        return None
    listening_fd, lock_fd = map(int, numbers)
    listening = socket.socket(fileno=listening_fd)
    lock = _Lock(path, inherited=lock_fd)
    for descriptor in (listening_fd, lock_fd):
        os.set_inheritable(descriptor, False)
    if lock.is_held and listening.getsockname() == os.fspath(path) and path.is_socket():
        return Listener(listening, path, lock)
    listening.close()
    lock.release()
    return None


def _may_enter(rights: SocketRights | None) -> int:
    """Bits that the default folder may have besides 0700: users that are let in must get there."""
    mode = 0 if rights is None else rights.mode
    return (0o050 if mode & stat.S_IWGRP else 0) | (0o055 if mode & stat.S_IWOTH else 0)


def _bind(path: Path, rights: SocketRights | None) -> socket.socket:
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        _remove_stale(path)
        listening.bind(os.fspath(path))
        try:
            _let_in(path, rights)  # before listen(): no process can connect in between
        except BaseException:
            path.unlink()
            raise
        listening.listen(BACKLOG)
        listening.setblocking(False)
    except OSError as error:
        listening.close()
        raise ConfigurationError(f"can't listen on '{path}': {error.strerror or error}") from None
    except BaseException:
        listening.close()
        raise
    return listening


def _let_in(path: Path, rights: SocketRights | None) -> None:
    """Set the mode and the group of the socket.

    Raises ConfigurationError if this process may not give it to that group. Then nothing changes.
    """
    mode = stat.S_IMODE(path.stat().st_mode)
    path.chmod(0o600)  # the group comes first: never another one, not for a moment
    if rights is None:
        return
    gid = rights.gid
    if gid is not None:
        try:
            os.chown(path, -1, gid, follow_symlinks=False)
        except PermissionError:
            path.chmod(mode)
            raise ConfigurationError(
                f"socket.group = {rights.group!r}: this user is not in that group, so busd can't give it "
                f"'{path}'; add the user to the group, or leave it out"
            ) from None
    path.chmod(rights.mode)


def _remove_stale(path: Path) -> None:
    """Remove the socket file of a dead daemon. The caller holds the lock.

    A socket that still answers is not stale, whatever the lock says: it is another program's, or its lock
    file fell to a cleaner of /tmp.
    """
    try:
        if not stat.S_ISSOCK(path.lstat().st_mode):
            raise ConfigurationError(f"'{path}' exists and is not a socket; busd does not replace it")
    except FileNotFoundError:
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            probe.connect(os.fspath(path))
        except ConnectionRefusedError:
            path.unlink()
            return
        except BlockingIOError:
            raise AlreadyRunning(path, None) from None  # alive, with a full backlog
        pid = peer_credentials(probe).pid
    raise AlreadyRunning(path, pid or None, program=process_name(pid))


class _Lock:
    """The right to serve one path."""

    def __init__(self, path: Path, *, inherited: int | None = None) -> None:
        """Raises AlreadyRunning if another process has it, ConfigurationError if its file is not ours.

        `inherited`: its descriptor, from the program that this process ran before; then look if it `is_held`.
        """
        self._path = path.with_name(f"{path.name}.lock")
        if inherited is not None:
            self._fd = inherited
            return
        try:
            # Each attempt that fails means that a holder left between our open and our flock.
            taken = next((fd for _ in range(_LOCK_ATTEMPTS) if (fd := self._try(path)) is not None), None)
        except OSError as error:
            reason = "it is a symbolic link" if error.errno == errno.ELOOP else error.strerror
            raise ConfigurationError(f"can't lock '{self._path}': {reason}") from None
        if taken is None:
            raise ConfigurationError(f"can't lock '{self._path}': it is replaced again and again")
        self._fd = taken

    def fileno(self) -> int:
        return self._fd

    @property
    def is_held(self) -> bool:
        """Whether the file is still in place."""
        return self._is_in_place(self._fd)

    def release(self) -> None:
        """Remove the file, then let go: a process that waits for its lock will notice."""
        try:
            if self._is_in_place(self._fd):
                self._path.unlink()
        except OSError:
            pass  # a file that stays behind unlocked does no harm
        os.close(self._fd)

    def _try(self, path: Path) -> int | None:
        # O_NONBLOCK: a pipe at this path must not block us before we have looked at it.
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
        fd = os.open(self._path, flags, 0o600)
        is_ours = False
        try:
            self._check(os.fstat(fd))
            try:
                fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise AlreadyRunning(path, _read_pid(fd)) from None
            is_ours = self._is_in_place(fd)
            if is_ours:
                with suppress(OSError):  # a full disk: errors of others will not name our pid
                    os.ftruncate(fd, 0)
                    os.pwrite(fd, f"{os.getpid()}\n".encode(), 0)
        except BaseException:
            os.close(fd)
            raise
        if is_ours:
            return fd
        os.close(fd)
        return None

    def _check(self, file: os.stat_result) -> None:
        # In a shared folder another user may have made it, even as a hard link to a file of ours.
        if not stat.S_ISREG(file.st_mode) or file.st_uid != os.geteuid() or file.st_nlink > 1:
            raise ConfigurationError(
                f"can't lock '{self._path}': it is not a regular file of this user (owner uid {file.st_uid}, "
                f"mode {stat.filemode(file.st_mode)}, {file.st_nlink} links)"
            )

    def _is_in_place(self, fd: int) -> bool:
        try:
            return _identity(os.fstat(fd)) == _identity(self._path.lstat())
        except FileNotFoundError:
            return False


def _identity(file: os.stat_result) -> tuple[int, int]:
    return file.st_dev, file.st_ino


def _read_pid(fd: int) -> int | None:
    """The holder's pid, or None while it has not written it yet and the file still names a dead one."""
    try:
        pid = int(os.pread(fd, 32, 0))
        os.kill(pid, 0)
    except PermissionError:
        return pid
    except (ValueError, OverflowError, ProcessLookupError):
        return None
    return pid if pid > 0 else None
