"""Two buses on this machine, for tests of programs that join them."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from bus.graph import Graph
from bus_cli.query import Query
from cli import Running, start
from neighbours import wait_until

__all__ = ["bridge", "script_on", "wait_for_graph_of"]


@contextmanager
def bridge(path: Path, *words: str) -> Iterator[Running]:
    """`bus bridge` on the bus at `path`. It has printed the name of that bus, and may not listen yet."""
    with start("bridge", *words, "--socket", str(path)) as running:
        running.error_line_with("this bus is ")
        yield running


@contextmanager
def script_on(path: Path, source: str, *arguments: str) -> Iterator[Running]:
    """A user's program on the bus at `path`, as by `cli.script`."""
    before = os.environ["BUSD_SOCKET"]
    os.environ["BUSD_SOCKET"] = str(path)
    try:
        running = Running(("-c", source, *arguments))
    finally:
        os.environ["BUSD_SOCKET"] = before
    with running:
        assert running.line() == "ready"
        yield running


def wait_for_graph_of(path: Path, fits: Callable[[Graph], object]) -> Graph:
    """The first graph of the bus at `path` that fits. Raises TimeoutError."""
    seen: list[Graph] = []
    with Query(path, may_start=False) as query:

        def has_come() -> bool:
            seen.append(query.graph(statistics=True))
            return bool(fits(seen[-1]))

        wait_until(has_come)
    return seen[-1]
