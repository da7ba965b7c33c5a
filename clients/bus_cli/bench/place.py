"""The bus that is measured: the one that runs, or one of its own, which ends with the measurement."""

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
    """A busd: its socket and pid, and whether it is of our own."""

    socket: str
    pid: int
    own: bool


@contextmanager
def find_bus(path: Path) -> Iterator[Place]:
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
    with Group() as group:
        busd = group.start_busd()
        yield Place(group.environ["BUSD_SOCKET"], busd.pid, True)
