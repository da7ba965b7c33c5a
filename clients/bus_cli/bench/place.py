"""The bus that is measured: the one that runs, or one of its own, which ends with the measurement."""

import asyncio
import contextlib
import os
import socket
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir

import msgspec

from bus.link.autostart import BUSD, is_allowed
from bus.process.address import MAX_PATH_BYTES
from bus_cli.output import CommandError
from bus_cli.query import NotRunning, Query

__all__ = ["Place", "find_bus"]

_TAIL_BYTES = 40
"""Of the path, more than what comes after the folder for temporary files."""
_START_S = 10.0
_END_S = 5.0
_IDLE_EXIT_S = 10
"""Should we be killed, it leaves by itself."""


class Place(msgspec.Struct, frozen=True):
    """A busd: its socket and pid, and whether it is of our own."""

    socket: str
    pid: int
    own: bool


@asynccontextmanager
async def find_bus(path: Path) -> AsyncIterator[Place]:
    """The busd that listens at `path`; where none does, one on a temporary socket until the block ends.

    Raises CommandError where none may be started (BUSD_AUTOSTART=0), or it does not come up.
    """
    try:
        with Query(path, may_start=False) as query:
            found = Place(str(path), query.broker.pid, False)
    except NotRunning:
        if not is_allowed():
            raise CommandError(
                f"no busd listens on {path}, and BUSD_AUTOSTART={os.environ['BUSD_AUTOSTART']} keeps this "
                f"from starting one; start one with: busd --socket {path}"
            ) from None
    else:
        yield found
        return
    with TemporaryDirectory(prefix="bus-bench-", dir=_short_folder()) as folder:
        own = Path(folder, "busd.sock")
        async with _busd(own) as pid:
            yield Place(str(own), pid, True)


def _short_folder() -> str:
    """The folder for temporary files; /tmp where that leaves too little room for a socket's path."""
    folder = gettempdir()
    return folder if len(os.fsencode(folder)) < MAX_PATH_BYTES - _TAIL_BYTES else "/tmp"


@asynccontextmanager
async def _busd(path: Path) -> AsyncIterator[int]:
    log = path.with_suffix(".log")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ready:
        ready.bind("")  # an abstract address that the kernel chooses
        ready.setblocking(False)
        environ = {**os.environ, "NOTIFY_SOCKET": "@" + ready.getsockname()[1:].decode()}
        process = await _spawn(path, log, environ)
        try:
            await _wait_until_ready(ready, process, log)
            yield process.pid
        finally:
            await _end(process)


async def _spawn(path: Path, log: Path, environ: Mapping[str, str]) -> asyncio.subprocess.Process:
    options = ("--socket", str(path), "--idle-exit", str(_IDLE_EXIT_S), "--log-level", "warn")
    with log.open("wb") as stderr:
        return await asyncio.create_subprocess_exec(
            *BUSD,
            *options,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=stderr,
            env=environ,
            start_new_session=True,
        )


async def _wait_until_ready(ready: socket.socket, process: asyncio.subprocess.Process, log: Path) -> None:
    loop = asyncio.get_running_loop()
    waits = {asyncio.create_task(loop.sock_recv(ready, 4096)), asyncio.create_task(process.wait())}
    try:
        await asyncio.wait(waits, timeout=_START_S, return_when=asyncio.FIRST_COMPLETED)
        is_ready = any(task.done() and isinstance(task.result(), bytes) for task in waits)
    finally:
        for task in waits:
            task.cancel()
        await asyncio.gather(*waits, return_exceptions=True)
    if not is_ready:
        raise CommandError(f"a busd could not be started: {_last_line(log)}")


def _last_line(log: Path) -> str:
    lines = log.read_text(errors="replace").strip().splitlines()
    return lines[-1] if lines else f"it is not ready after {_START_S:g} s"


async def _end(process: asyncio.subprocess.Process) -> None:
    """In order; killed where that takes long, or nobody wants to wait."""
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
    try:
        async with asyncio.timeout(_END_S):
            await process.wait()
    except TimeoutError:
        pass
    finally:
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
