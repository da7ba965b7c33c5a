"""A bus of its own for one verb, so that it changes nothing on the user's bus."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
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
    """A busd in a temporary folder; yields the path of its socket. At the end both are gone."""
    with TemporaryDirectory(prefix="busd-") as folder:
        path = Path(folder) / "busd.sock"
        try:
            await start(path, ("--idle-exit", str(_IDLE_EXIT_S)))
        except BusError as error:
            raise CommandError(error) from None
        try:
            yield path
        finally:
            stop(path)
