"""A separate bus for one verb, which changes nothing on the user's bus."""

import asyncio
import fcntl
import os
import signal
import stat
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory, gettempdir

from bus.errors import BusError
from bus.link.autostart import start
from bus_cli.daemon.stop import stop
from bus_cli.output import CommandError

__all__ = ["own_bus"]

_IDLE_EXIT_S = 30
"""busd ends by itself after this time without a client, if the verb was killed."""

_PREFIX = "busd-"
_LOCK = "verb.lock"
"""A file in the folder that the verb locks. So the folder of a killed verb can be told from others."""
_LOCK_OF_BUSD = "busd.sock.lock"


@asynccontextmanager
async def own_bus() -> AsyncIterator[Path]:
    """A busd in a temporary folder; yields the path of its socket. At the end both are gone.

    Meanwhile the end of the terminal (SIGHUP) ends the verb like SIGTERM: it would leave the folder behind.
    If the verb is killed, the next one removes the folder.
    """
    _remove_those_of_killed_verbs()
    with (
        _ending_with_the_terminal(),
        TemporaryDirectory(prefix=_PREFIX) as folder,
        _marked(Path(folder)),
    ):
        path = Path(folder) / "busd.sock"
        try:
            await start(path, ("--idle-exit", str(_IDLE_EXIT_S)))
        except BusError as error:
            raise CommandError(error) from None
        try:
            yield path
        finally:
            stop(path)


@contextmanager
def _ending_with_the_terminal() -> Iterator[None]:
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_DFL:  # as under nohup
        yield
        return
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGHUP, signal.raise_signal, signal.SIGTERM)
    try:
        yield
    finally:
        loop.remove_signal_handler(signal.SIGHUP)


@contextmanager
def _marked(folder: Path) -> Iterator[None]:
    """Lock a new file in `folder`. It gets its name once it is locked, so the folder is never free."""
    new = folder / f"{_LOCK}.new"
    new.touch(0o600)
    with _locked(new):
        new.rename(folder / _LOCK)
        yield


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Raises OSError if another process has the lock, or if there is no such file."""
    fd = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(fd)


def _remove_those_of_killed_verbs() -> None:
    """Remove folders of this user that a verb has marked, if the verb and its busd have ended."""
    for mark in Path(gettempdir()).glob(f"{_PREFIX}*/{_LOCK}"):
        with suppress(OSError), ExitStack() as locks:
            of_folder = mark.parent.lstat()
            if not stat.S_ISDIR(of_folder.st_mode) or of_folder.st_uid != os.geteuid():
                continue
            locks.enter_context(_locked(mark))
            with suppress(FileNotFoundError):  # busd removes it at its end
                locks.enter_context(_locked(mark.with_name(_LOCK_OF_BUSD)))
            rmtree(mark.parent)
