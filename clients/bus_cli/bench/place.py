"""The bus to measure: the running one, or a temporary one, which ends with the measurement."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from bus.link.reach import is_allowed
from bus_cli.bench.harness import Group
from bus_cli.output import CommandError
from bus_cli.query import NotRunning, Query

__all__ = ["Place", "find_bus"]


class Place(msgspec.Struct, frozen=True):
    """A busd: its socket and pid, and whether this program started it."""

    socket: str
    pid: int
    own: bool


@contextmanager
def find_bus(path: Path) -> Iterator[Place]:
    """The busd that listens at `path`; if there is none, a temporary one, which runs until the block ends.

    Raises CommandError if no busd may be started (BUSD_AUTOSTART=0), or if it does not start.
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
    with Group() as group:
        busd = group.start_busd()
        yield Place(group.environ["BUSD_SOCKET"], busd.pid, True)
