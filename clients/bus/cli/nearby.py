"""What was meant by a name that does not exist: the end of a verb's message, "" where nothing is near.

Names come from the graph, and from the definitions and packages on this machine. Slow, and needed for slips
only: import it late.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from bus.names import is_hidden_topic
from bus.spelling import did_you_mean, nearest

if TYPE_CHECKING:
    from bus.graph import Graph
    from bus.interfaces import Kind

__all__ = ["near_node", "near_package", "near_service", "near_topic", "near_type", "types_called"]

_EXAMPLES = "example_interfaces/"


def near_topic(name: str, graph: "Graph") -> str:
    return _near(name, (topic for topic in graph.topics() if not is_hidden_topic(topic)))


def near_service(name: str, graph: "Graph") -> str:
    return _near(name, (service for service in graph.services() if not is_hidden_topic(service)))


def near_node(name: str, graph: "Graph") -> str:
    return _near(name, {node.full_name for node in graph.nodes})


def near_type(text: str, kind: "Kind | None" = "msg", graph: "Graph | None" = None) -> str:
    """Of the types that are defined here and, for messages, of those on the bus."""
    from bus.interfaces import names

    found = dict.fromkeys(names(kind))
    if graph is not None and kind == "msg":
        found |= dict.fromkeys(name for types in graph.topics().values() for name in types if "/msg/" in name)
    if text in found:
        return ""
    if "/" in text:
        return did_you_mean(text, found, 0.75)
    shorts = {name.rpartition("/")[2] for name in found}
    called = types_called(text, found) or types_called(nearest(text, sorted(shorts), 0.75) or "", found)
    return f"; did you mean '{_listed(called)}'?" if called else ""


def near_package(name: str) -> str:
    """Of the packages that have programs or a manifest."""
    from bus.packages import nearest

    near = nearest(name)
    return f"; did you mean '{near}'?" if near else ""


def types_called(short: str, among: Iterable[str]) -> list[str]:
    """The full names that end in `short`. ROS's examples count where there are no others."""
    found = [name for name in among if name.rpartition("/")[2].lower() == short.lower()]
    return [name for name in found if not name.startswith(_EXAMPLES)] or found


def _near(name: str, among: Iterable[str]) -> str:
    """As they were typed, names may lack their slash."""
    full = name if name.startswith("/") else f"/{name}"
    return did_you_mean(full, set(among) - {full})


def _listed(names: list[str]) -> str:
    return "' or '".join(names)
