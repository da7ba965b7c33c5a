"""Reports of `bus doctor --report`: facts without a judgement, in the layout of ROS 2."""

import platform
import sys
from collections.abc import Collection, Iterable, Iterator
from typing import NamedTuple

from bus.base.version import RELEASE
from bus.graph import Graph
from bus.names import is_hidden_topic
from bus_cli.doctor.finding import Finding
from bus_cli.doctor.topics import pairs

__all__ = ["Report", "category_of", "reports", "text_of"]

_PACKAGES = ("busd", "msgspec", "uvloop", "PyYAML", "numpy", "mcap", "websockets", "textual", "argcomplete")
_OF_PACKAGES = ("python", "ros2", "busd", "msgspec", "uvloop", "native core")
_OF_PLATFORM = ("shared memory", "open files", "socket buffer", "memory", "clock", "receive buffers")
_NOT_LISTED = ("/rosout", "/parameter_events")
_LEAST_WIDTH, _GAP = 8, 4


class Report(NamedTuple):
    """Lines of a name and a value under a title."""

    category: str
    title: str
    items: list[tuple[str, object]]


def category_of(finding: Finding) -> str:
    """The category of the reports that belong to a finding."""
    if finding.subject in _OF_PACKAGES:
        return "package"
    if finding.subject in _OF_PLATFORM:
        return "platform"
    return "topic" if finding.subject == "topics" else "middleware"


def reports(
    path: object, graph: Graph | None, pid: int | None, *, categories: Collection[str] | None = None
) -> Iterator[Report]:
    """The reports of the `categories`, or all. Without a daemon there is no `graph` and no `pid`."""
    made = (_bus(path, graph, pid), _packages(), _platform(), _topics(graph), _compatibility(graph))
    return (report for report in made if categories is None or report.category in categories)


def text_of(report: Report) -> str:
    """The report as ROS 2 prints it, after an empty line."""
    longest = max((len(name) for name, _ in report.items), default=0)
    width = longest + _GAP if longest >= _LEAST_WIDTH else _LEAST_WIDTH
    lines = [f"{name:{width}}: {value}" for name, value in report.items]
    return "\n".join(["", f"   {report.title}", *lines])


def _bus(path: object, graph: Graph | None, pid: int | None) -> Report:
    items: list[tuple[str, object]] = [
        ("middleware name", "busd"),
        ("release", RELEASE),
        ("socket", str(path)),
    ]
    items.append(("daemon", "not running" if pid is None else f"pid {pid}"))
    if graph is not None:
        items.append(("nodes", len(graph.nodes)))
    return Report("middleware", "RMW MIDDLEWARE", items)


def _packages() -> Report:
    from bus_cli.main import version

    found = [(name, version(name)) for name in _PACKAGES]
    items = [(name, f"installed={installed}") for name, installed in found if installed is not None]
    return Report("package", "PACKAGE VERSIONS", [("python", platform.python_version()), *items])


def _platform() -> Report:
    return Report(
        "platform",
        "PLATFORM INFORMATION",
        [
            ("system", platform.system()),
            ("platform info", platform.platform()),
            ("release", platform.release()),
            ("processor", platform.processor()),
            ("python", sys.executable),
        ],
    )


def _topics(graph: Graph | None) -> Report:
    topics = graph.topics() if graph is not None else {}
    names = [topic for topic in topics if not is_hidden_topic(topic) and topic not in _NOT_LISTED]
    return Report("topic", "TOPIC LIST", list(_lines_of_topics(graph, names)))


def _lines_of_topics(graph: Graph | None, names: Iterable[str]) -> Iterator[tuple[str, object]]:
    is_empty = True
    for name in names:
        assert graph is not None
        is_empty = False
        yield "topic", name
        yield "publisher count", len(graph.publishers_of(name))
        yield "subscriber count", len(graph.subscriptions_of(name))
    if is_empty:
        yield from (("topic", "none"), ("publisher count", 0), ("subscriber count", 0))


def _compatibility(graph: Graph | None) -> Report:
    items: list[tuple[str, object]] = []
    for publisher, subscription, reason in pairs(graph) if graph is not None else ():
        if is_hidden_topic(publisher.topic):
            continue
        items += [
            ("topic [type]", f"{publisher.topic} [{publisher.type_name}]"),
            ("publisher node", publisher.node.name),
            ("subscriber node", subscription.node.name),
            ("compatibility status", reason or "OK"),
        ]
    if not items:
        items.append(("compatibility status", "No publisher/subscriber pairs found"))
    return Report("topic", "QOS COMPATIBILITY LIST", items)
