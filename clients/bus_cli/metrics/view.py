"""One look at the bus: the graph with its counters, and what everybody makes busd hold.

Owns what is asked, and what counts as busd not being there. Must not know how it is written.
"""

from pathlib import Path
from time import monotonic

import msgspec

from bus.errors import BusError
from bus.graph import Graph
from bus.wire import messages as m
from bus_cli.query import NotRunning, Query

__all__ = ["View", "look"]

_ANSWER_S = 2.0
"""A scraper gives up after some ten seconds; a healthy busd answers in milliseconds."""


class View(msgspec.Struct, frozen=True):
    """What was seen, and how long the look took; `charges` is None where busd gave none."""

    hello: m.Hello
    graph: Graph
    charges: m.Peers | None
    seconds: float


def look(path: Path) -> View | str:
    """What busd at `path` says, or why there is nothing to say. Takes seconds at most, and starts no busd."""
    began_s = monotonic()
    try:
        with Query(path, may_start=False, answer_s=_ANSWER_S) as query:
            graph = query.graph(statistics=True)
            return View(query.broker, graph, query.charges(), monotonic() - began_s)
    except NotRunning:
        return f"no busd listens on {path}"
    except BusError as error:
        return str(error)
