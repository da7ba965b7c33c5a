"""The file into which a busd in the background logs. The process that starts busd opens it; both turn it
over.

Owns its name, its mark, and how it is opened: at once, whatever lies there, and without harm to anything that
is not a log of busd's. Must not know what is logged.

Invariants:
- A file that is written to, renamed or emptied begins with the mark, is a regular file of this user, and
  nobody else may write to it.
- A process that turns the file over holds an flock on it and has seen that it is still the one at its path.
  So of many that find it full at the same time one does it, and none loses a file that another has begun.
"""

import errno
import fcntl
import os
import stat
import time
from pathlib import Path

from bus.errors import ConfigurationError

__all__ = ["MARK", "MOST_BYTES", "empty", "find_fault", "is_log", "log_path", "open_in_memory", "open_log"]

MARK = b"# busd's own log: "
"""The beginning of the first line, whatever the format of the others."""

MOST_BYTES = 1 << 20
"""A file of this size becomes the old one, in place of an earlier old one."""

_FIRST_LINE = MARK + b"at 1 MiB it goes on in a new file, and this one is kept beside it as *.log.1\n"
_FLAGS = os.O_RDWR | os.O_APPEND | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC
_NO_MARK = f"'{{}}' is not a log of busd's: it does not begin with \"{MARK.decode().strip()}\""
_ATTEMPTS = 20
_RETRY_S = 0.005


def log_path(socket: Path) -> Path:
    """Beside the socket: `0.log` for `0.sock`, for any other name that name and `.log`."""
    return socket.with_name(f"{socket.name.removesuffix('.sock') or socket.name}.log")


def open_log(path: Path, most_bytes: int = MOST_BYTES) -> int:
    """A descriptor of the log at `path`, to append to. Makes a missing file, and turns over a full one.

    Raises ConfigurationError where the file can't be opened, or where something else is there, which stays
    as it is.
    """
    try:
        for attempt in range(_ATTEMPTS):
            if attempt:
                time.sleep(_RETRY_S)  # another process is about to write its mark, or to turn it over
            fd = _make(path) if not os.path.lexists(path) else _open(path)
            if fd is None:
                continue
            is_good = False
            try:
                is_good = os.fstat(fd).st_size < most_bytes or not _turn_over(fd, path)
            finally:
                if not is_good:
                    os.close(fd)
            if is_good:
                return fd
    except OSError as error:
        raise ConfigurationError(f"can't open busd's log '{path}': {error.strerror}") from None
    raise ConfigurationError(_NO_MARK.format(path))


def open_in_memory() -> int:
    """A descriptor for a log without a file: in memory, or /dev/null where there is none."""
    try:
        fd = os.memfd_create("busd.log")
    except (AttributeError, OSError):
        return os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)
    try:
        fcntl.fcntl(fd, fcntl.F_SETFL, os.O_APPEND)
        _begin(fd)
    except OSError:
        os.close(fd)
        return os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)
    return fd


def is_log(fd: int) -> bool:
    """Whether it is a log, with a file or in memory, that may be turned over and emptied."""
    try:
        return stat.S_ISREG(os.fstat(fd).st_mode) and os.pread(fd, len(MARK), 0) == MARK
    except OSError:
        return False


def empty(fd: int) -> None:
    """Begin anew in the same log."""
    os.ftruncate(fd, os.pread(fd, 1024, 0).index(b"\n") + 1)  # the mark is there at every moment


def find_fault(path: Path) -> str:
    """Why a busd could not have its log at `path`; "" where it could."""
    try:
        if (fd := _open(path)) is not None:
            os.close(fd)
        elif os.path.lexists(path):
            return _NO_MARK.format(path)
    except (ConfigurationError, OSError) as error:
        return str(error)
    return ""


def _make(path: Path) -> int | None:
    """None where another process was first."""
    try:
        fd = os.open(path, _FLAGS | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        return None
    try:
        _begin(fd)
    except BaseException:
        path.unlink()  # without its mark it would be in the way for ever
        os.close(fd)
        raise
    return fd


def _open(path: Path) -> int | None:
    """None where it is empty, or gone by now. Raises ConfigurationError where it is something else."""
    try:
        _check(path, path.lstat())  # before it is opened: opening alone acts on some kinds of files
        fd = os.open(path, _FLAGS)
    except FileNotFoundError:
        return None
    is_ours = False
    try:
        _check(path, os.fstat(fd))
        head = os.pread(fd, len(MARK), 0)
        is_ours = head == MARK
        if head and not is_ours:
            raise ConfigurationError(_NO_MARK.format(path))
    finally:
        if not is_ours:
            os.close(fd)
    return fd if is_ours else None


def _check(path: Path, found: os.stat_result) -> None:
    if not stat.S_ISREG(found.st_mode):
        reason = f"it is no regular file (mode {stat.filemode(found.st_mode)})"
    elif found.st_uid != os.geteuid():
        reason = f"it belongs to user {found.st_uid}"
    elif found.st_nlink > 1:
        reason = f"it has {found.st_nlink} names"
    elif found.st_mode & 0o022:
        reason = f"others may write to it (mode {stat.S_IMODE(found.st_mode):04o})"
    else:
        return
    raise ConfigurationError(f"'{path}' is not a log of busd's: {reason}")


def _begin(fd: int) -> None:
    if os.write(fd, _FIRST_LINE) != len(_FIRST_LINE):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _turn_over(fd: int, path: Path) -> bool:
    """Make `path` free for a new file, or empty the file where something else has the old one's name.

    Returns whether to open it again; False: another process is at it, and the file will do for now.
    """
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)  # until it is closed
    except BlockingIOError:
        return False
    old = path.with_name(f"{path.name}.1")
    try:
        if not os.path.samestat(os.fstat(fd), path.lstat()):
            return True
        if not find_fault(old):
            path.rename(old)
            return True
    except FileNotFoundError:
        return True
    except OSError:
        pass  # the folder may be closed to us by now
    empty(fd)
    return True
