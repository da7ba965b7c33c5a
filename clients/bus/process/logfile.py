"""The log file of a busd in the background. The process that starts busd opens it; both turn it over.

Owns its name, its mark, and the rules to open it: without a wait, for any object at the path, and without
harm to a file that is not busd's log. Must not know the log's content.

Invariants:
- A file is written, renamed or emptied only if it begins with the mark and is a regular file of this user,
  and if no other user may write to it.
- A process that turns the file over holds an flock on it, and has checked that the file is still at its path.
  If many processes find it full at the same time, one turns it over, and none loses a file that another has
  begun.
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
"""The beginning of the first line, for any format of the other lines."""

MOST_BYTES = 1 << 20
"""A file of this size becomes the old file, and replaces an earlier old file."""

_FIRST_LINE = MARK + b"at 1 MiB it goes on in a new file, and this one is kept beside it as *.log.1\n"
_FLAGS = os.O_RDWR | os.O_APPEND | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC
_NO_MARK = f"'{{}}' is not a log of busd's: it does not begin with \"{MARK.decode().strip()}\""
_ATTEMPTS = 20
_RETRY_S = 0.005


def log_path(socket: Path) -> Path:
    """The path of the log, beside the socket: `0.log` for `0.sock`; for any other name, that name plus
    `.log`."""
    return socket.with_name(f"{socket.name.removesuffix('.sock') or socket.name}.log")


def open_log(path: Path, most_bytes: int = MOST_BYTES) -> int:
    """Open the log at `path` to append to it. Makes a missing file, and turns over a full one.

    Raises ConfigurationError if the file can't be opened, or if another object is at the path, which stays as
    it is.
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
    """A descriptor for a log without a file: in memory, or /dev/null if that is impossible."""
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
    """Whether `fd` is a log, in a file or in memory, that may be turned over and emptied."""
    try:
        return stat.S_ISREG(os.fstat(fd).st_mode) and os.pread(fd, len(MARK), 0) == MARK
    except OSError:
        return False


def empty(fd: int) -> None:
    """Empty the log, except its first line."""
    os.ftruncate(fd, os.pread(fd, 1024, 0).index(b"\n") + 1)  # the mark stays at every moment


def find_fault(path: Path) -> str:
    """The reason why a busd could not have its log at `path`; "" if it could."""
    try:
        if (fd := _open(path)) is not None:
            os.close(fd)
        elif os.path.lexists(path):
            return _NO_MARK.format(path)
    except (ConfigurationError, OSError) as error:
        return str(error)
    return ""


def _make(path: Path) -> int | None:
    """Make the file; None if another process was first."""
    try:
        fd = os.open(path, _FLAGS | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        return None
    try:
        _begin(fd)
    except BaseException:
        path.unlink()  # without its mark, no process would ever use or replace it
        os.close(fd)
        raise
    return fd


def _open(path: Path) -> int | None:
    """Open the file; None if it is empty, or gone by now. Raises ConfigurationError if it is no log."""
    try:
        _check(path, path.lstat())  # before the open, because that alone has effects on some kinds of files
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
    """Make `path` free for a new file; or empty the file if another object has the old file's name.

    Returns whether to open it again. False: another process turns it over, and the file can be used for now.
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
        pass  # the folder may not be writable for us any more
    empty(fd)
    return True
