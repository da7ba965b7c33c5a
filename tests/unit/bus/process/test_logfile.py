"""bus.process.logfile: the files that are logs of busd, and that busd changes no other file at their
paths.
"""

import errno
import fcntl
import os
import resource
import socket
import stat
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from bus.errors import ConfigurationError
from bus.process import logfile
from bus.process.logfile import (
    MARK,
    MOST_BYTES,
    empty,
    find_fault,
    is_log,
    log_path,
    open_in_memory,
    open_log,
)
from rows import for_each

STRANGER = 12345
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file to another user")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "0.log"


@pytest.fixture
def old(path: Path) -> Path:
    return path.with_name("0.log.1")


def append(path: Path, text: str = "") -> None:
    fd = open_log(path)
    os.write(fd, text.encode())
    os.close(fd)


def lines(path: Path) -> list[str]:
    """The appended lines, without the file's first line."""
    first, *rest = path.read_text().splitlines()
    assert first.startswith(MARK.decode())
    return rest


def fill(path: Path, text: str) -> None:
    append(path, f"{text}\n{'x' * MOST_BYTES}\n")


@for_each(
    ("name", "log"),
    [
        ("0.sock", "0.log"),
        ("app", "app.log"),
        ("app.log", "app.log.log"),
        ("app.bus", "app.bus.log"),
        (".sock", ".sock.log"),
        ("a.sock.sock", "a.sock.log"),
    ],
)
def test_its_name(name: str, log: str) -> None:
    """The log never has the socket's own name."""
    assert log_path(Path("/run", name)) == Path("/run", log)


def test_a_new_one_and_what_is_appended(path: Path) -> None:
    append(path, "one\n")
    append(path, "two\n")
    assert lines(path) == ["one", "two"]
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


@contextmanager
def thing(kind: str, path: Path) -> Iterator[None]:
    """Something that is not a log of busd."""
    match kind:
        case "text":
            path.write_text("precious\n")
        case "empty":
            path.touch(0o600)
        case "almost":
            path.write_bytes(MARK[:-1])
        case "link":
            target = path.with_name("target")
            append(target)
            path.symlink_to(target)
        case "dangling":
            path.symlink_to("nowhere")
        case "two names":
            append(path.with_name("other"))
            os.link(path.with_name("other"), path)
        case "open to others":
            append(path)
            path.chmod(0o622)
        case "folder":
            path.mkdir()
        case "fifo":
            os.mkfifo(path)
        case "socket":
            with socket.socket(socket.AF_UNIX) as listening:
                listening.bind(str(path))
        case "device":
            os.mknod(path, stat.S_IFCHR | 0o600, os.makedev(1, 7))  # /dev/full
        case "of another user":
            append(path)
            os.chown(path, STRANGER, STRANGER)
    yield


KINDS = [
    "text",
    "empty",
    "almost",
    "link",
    "dangling",
    "two names",
    "open to others",
    "folder",
    "fifo",
    "socket",
]
KINDS_OF_ROOT = [pytest.param(kind, marks=as_root) for kind in ("device", "of another user")]
every_kind = pytest.mark.parametrize("kind", [*KINDS, *KINDS_OF_ROOT])


def look(path: Path) -> tuple[object, ...]:
    found = path.lstat()
    content = path.read_bytes() if stat.S_ISREG(found.st_mode) else b""
    return found.st_ino, found.st_mode, found.st_uid, found.st_size, found.st_mtime_ns, content


@every_kind
def test_what_is_something_else_is_left_alone(kind: str, path: Path) -> None:
    with thing(kind, path):
        before = look(path)
        with pytest.raises(ConfigurationError, match=f"^'{path}' is not a log of busd's: ") as caught:
            open_log(path)
        assert find_fault(path) == str(caught.value)
        assert look(path) == before
    assert not path.with_name("nowhere").exists()


@every_kind
def test_so_is_what_has_the_old_one_s_name(kind: str, path: Path, old: Path) -> None:
    """The log stays bounded all the same: it starts again in the same file."""
    with thing(kind, old):
        before = look(old)
        fill(path, "first")
        append(path, "second\n")
        assert look(old) == before
        assert lines(path) == ["second"]


def test_a_full_one_is_kept_once(path: Path, old: Path) -> None:
    for text in ("first", "second"):
        fill(path, text)
    assert lines(old)[0] == "first"
    append(path, "third\n")
    assert (lines(old)[0], lines(path)) == ("second", ["third"])
    assert {one.name for one in path.parent.iterdir()} == {"0.log", "0.log.1"}


def test_of_many_that_find_it_full_one_turns_it_over(path: Path, old: Path) -> None:
    for turn in range(5):
        path.unlink(missing_ok=True)
        fill(path, f"full {turn}")
        together = threading.Barrier(8)

        def come(number: int, together: threading.Barrier = together) -> None:
            together.wait()
            append(path, f"{number}\n")

        with ThreadPoolExecutor(8) as pool:
            list(pool.map(come, range(8)))
        kept, new = lines(old), lines(path)
        assert kept[0] == f"full {turn}"
        assert sorted([*kept[2:], *new]) == [*map(str, range(8))]


def test_one_that_is_being_turned_over_is_good_for_now(path: Path, old: Path) -> None:
    fill(path, "first")
    fd = os.open(path, os.O_RDONLY)
    fcntl.flock(fd, fcntl.LOCK_EX)
    append(path, "second\n")
    os.close(fd)
    assert not old.exists()
    assert lines(path)[-1] == "second"


def test_one_that_is_made_just_now_is_waited_for(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path.touch()

    def write_the_mark(_: float) -> None:
        append(path.with_name("other"))
        path.with_name("other").rename(path)

    monkeypatch.setattr(logfile.time, "sleep", write_the_mark)  # type: ignore[attr-defined]
    append(path, "text\n")
    assert lines(path) == ["text"]


def test_one_without_room_for_its_mark_leaves_nothing(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(fd: int, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "write", fail)
    with pytest.raises(ConfigurationError, match=f"can't open busd's log '{path}': No space left on device"):
        open_log(path)
    assert not path.exists()


def test_where_there_is_no_folder(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="No such file or directory"):
        open_log(tmp_path / "none" / "0.log")
    assert not list(tmp_path.iterdir())


class TestInMemory:
    def test_it_is_a_log(self) -> None:
        fd = open_in_memory()
        with closing(os.fdopen(fd, "rb")):
            assert is_log(fd)
            os.write(fd, b"text\n")
            os.pread(fd, 1, 0)
            os.write(fd, b"more\n")
            assert os.pread(fd, 1024, 0).endswith(b"\ntext\nmore\n")

    def test_where_there_is_none(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.delattr(os, "memfd_create")
        fd = open_in_memory()
        assert os.path.samestat(os.fstat(fd), os.stat(os.devnull))  # noqa: PTH116
        assert not is_log(fd)
        os.close(fd)

    def test_where_it_may_have_no_size(self) -> None:
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))
        try:
            fd = open_in_memory()
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        assert not is_log(fd)
        os.close(fd)


@pytest.mark.parametrize("make", [open_in_memory, None])
def test_it_begins_anew_with_its_mark(make: Callable[[], int] | None, path: Path) -> None:
    fd = make() if make else open_log(path)
    os.write(fd, b"text\n")
    empty(fd)
    os.write(fd, b"more\n")
    _, *rest = os.pread(fd, 1024, 0).splitlines()
    assert (is_log(fd), rest) == (True, [b"more"])
    os.close(fd)


def test_what_is_no_log(path: Path) -> None:
    path.write_bytes(MARK[1:])
    with path.open() as file:
        assert not is_log(file.fileno())
    ours, theirs = os.pipe()
    assert not is_log(ours) and not is_log(theirs) and not is_log(-1)
    os.close(ours)
    os.close(theirs)
