"""One view of the bus: the graph with its counters, the resources that busd holds, the counters of bridges.

Owns the questions, and the decision that busd is not available. Must not know how the metrics are written.
"""

from collections.abc import Mapping
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

import msgspec

from bus.errors import BusError
from bus.graph import Graph
from bus.wire import messages as m
from bus_cli.query import NotRunning, Query

if TYPE_CHECKING:
    from bus_cli.bridge.remote import Answer

__all__ = ["View", "read_view"]

_ANSWER_S = 2.0
"""A scraper waits about ten seconds; a healthy busd answers in milliseconds."""


class View(msgspec.Struct, frozen=True):
    """The answers of busd, and the time that they took; `charges` is None if busd gave none."""

    hello: m.Hello
    graph: Graph
    charges: m.Peers | None
    seconds: float
    bridges: "Mapping[str, Answer]" = {}
    """Status of each bridge that answered, by the full name of its node."""


def read_view(path: Path) -> View | str:
    """The view of the busd at `path`, or the reason for none. Takes some seconds at most; starts no busd."""
    began_s = monotonic()
    try:
        with Query(path, may_start=False, answer_s=_ANSWER_S) as query:
            graph = query.graph(statistics=True)
            charges, seconds = query.charges(), monotonic() - began_s
            return View(query.broker, graph, charges, seconds, _ask_bridges(path, graph))
    except NotRunning:
        return f"no busd listens on {path}"
    except BusError as error:
        return str(error)


def _ask_bridges(path: Path, graph: Graph) -> "Mapping[str, Answer]":
    """The status of the bridges in `graph`. Without bridges, it does not import the node that asks them."""
    from bus_bridge.core.status import SERVICE_TYPE

    if not any(SERVICE_TYPE in types for types in graph.services().values()):
        return {}
    import asyncio

    from bus_cli.bridge.remote import ask_all

    answers = asyncio.run(ask_all(path, graph))
    return {name: answer for name, answer in answers.items() if not isinstance(answer, str)}
