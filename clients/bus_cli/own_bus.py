"""A separate bus for one verb, which changes nothing on the user's bus."""

import asyncio
import signal
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from bus.errors import BusError
from bus.link.autostart import start
from bus_cli.daemon.stop import stop
from bus_cli.output import CommandError

__all__ = ["own_bus"]

_IDLE_EXIT_S = 30
"""busd ends by itself after this time without a client, if the verb was killed."""


@asynccontextmanager
async def own_bus() -> AsyncIterator[Path]:
    """A busd in a temporary folder; yields the path of its socket. At the end both are gone.

    Meanwhile the end of the terminal (SIGHUP) ends the verb like SIGTERM: it would leave the folder behind.
    """
    with _ending_with_the_terminal(), TemporaryDirectory(prefix="busd-") as folder:
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
