"""One look at the bus: the graph with its counters, what everybody makes busd hold, what bridges count.

Owns what is asked, and what counts as busd not being there. Must not know how it is written.
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
"""A scraper gives up after some ten seconds; a healthy busd answers in milliseconds."""


class View(msgspec.Struct, frozen=True):
    """What was seen, and how long the look took; `charges` is None where busd gave none."""

    hello: m.Hello
    graph: Graph
    charges: m.Peers | None
    seconds: float
    bridges: "Mapping[str, Answer]" = {}
    """By the full names of their nodes; without those that did not answer."""


def read_view(path: Path) -> View | str:
    """What busd at `path` says, or why there is nothing to say. Takes seconds at most, and starts no busd."""
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
    """What the bridges in `graph` say. To ask takes a node, so nothing is imported where there are none."""
    from bus_bridge.core.status import SERVICE_TYPE

    if not any(SERVICE_TYPE in types for types in graph.services().values()):
        return {}
    import asyncio

    from bus_cli.bridge.remote import ask_all

    answers = asyncio.run(ask_all(path, graph))
    return {name: answer for name, answer in answers.items() if not isinstance(answer, str)}
