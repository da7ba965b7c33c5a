"""`make api`: docs/api.md, made from the docstrings of all public names of `bus`.

GROUPS lists the names by task. A member that GROUPS does not name is shown with its class.
"""

import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

from apisource import Entry, entries
from bus import msg, qos, srv, testing

PAGE = Path(__file__).parents[1] / "docs" / "api.md"
HEAD = """\
# API

All public names of `bus`, grouped by task. Whole programs are in
[patterns.md](patterns.md). This page is made from the docstrings by `make api`.

Durations are seconds, as float or int. `async` methods are awaited on the event loop of their node. Other
methods never block. `Publisher.publish`, `ServiceServer.respond`, `ServiceClient.send_request` and loggers
may be used from any thread, everything else only on the event loop's thread. When a node is closed,
everything that it made is closed, too. Scripts that have no event loop use [`bus.connect`](#busconnect).
"""

GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "Run a program": ("", ("run", "Node", "NodeStatistics", "__version__")),
    "Publish": ("", ("Node.create_publisher", "Publisher", "Loan", "PublisherStatistics")),
    "Subscribe": ("", ("Node.create_subscription", "Subscription", "MessageInfo", "SubscriptionStatistics")),
    "Call and serve": (
        "[services.md](services.md) lists possible losses of requests and answers.",
        (
            *("Service", "Node.create_client", "ServiceClient", "ServiceClientStatistics"),
            *("Node.create_service", "ServiceServer", "RequestId", "ServiceServerStatistics"),
        ),
    ),
    "Messages": (
        "Any `msgspec.Struct` is a message type. ROS 2's are ready-made, a module for each package:\n\n"
        "- `from bus.msg.std_msgs import String`; packages: MESSAGES. `bus.msg` itself has `Message`, a base "
        "for your own types, and ROS's primitive types: PRIMITIVES.\n"
        "- `from bus.srv.std_srvs import SetBool`; packages: SERVICES.",
        ("MessageSchema", "Node.get_schema", "Node.get_type"),
    ),
    "Without an event loop": (
        "Every call blocks until it is done. [scripts.md](scripts.md) has whole scripts.",
        ("connect", "BlockingNode", "BlockingPublisher", "BlockingSubscription"),
    ),
    "Test": (
        "`bus.testing` is a pytest plugin that gives each test a separate bus: TESTING. "
        "[testing.md](testing.md) shows how it is used.",
        (),
    ),
    "Time": ("", ("Node.create_timer", "Timer", "Node.now", "Node.create_rate", "Rate")),
    "Parameters": (
        "[parameters.md](parameters.md) has their types, and how the command line and files set them.",
        (
            *("Node.declare_parameter", "Node.undeclare_parameter", "Node.has_parameter"),
            *("Node.get_parameter", "Node.get_parameters", "Node.set_parameter", "Node.set_parameters"),
            *("Node.pre_set_parameters", "Node.on_set_parameters", "Node.post_set_parameters"),
            "Node.remove_parameters_callback",
        ),
    ),
    "Log": ("", ("get_logger", "Node.get_logger", "Logger", "Severity")),
    "Look at the graph": (
        "",
        (
            *(
                "Node.graph",
                "Node.watch_graph",
                "Node.wait_for_graph",
                "Graph",
                "GraphNode",
                "Origin",
                "GraphEndpoint",
                "GraphMatch",
            ),
            *("EndpointStatistics", "Match"),
        ),
    ),
    "Hear of matches, losses and deadlines": (
        "[qos.md](qos.md) says when each event occurs.",
        (
            *("PublisherEvents", "SubscriptionEvents", "MatchedChange", "MessageLost", "IncompatibleQoS"),
            *("IncompatibleType", "DeadlineMissed", "LivelinessChanged", "LivelinessLost"),
        ),
    ),
    "Quality of service": (
        'As a QoS argument, an int is a depth and a text is the name of a preset: `"sensor_data"` is '
        "`bus.qos.sensor_data`. `bus.qos.check_compatible(offered, requested)` lists the reasons why two "
        "profiles do not match. [qos.md](qos.md) explains each policy.",
        ("QoS", "QoSProfile", "qos", "History", "Reliability", "Durability", "Liveliness"),
    ),
    "Errors": (
        "Expected outcomes are return values or counters; exceptions are for faults. Time-outs are "
        "Python's `TimeoutError`, of `asyncio.timeout`.\n\n"
        "```python\n"
        "try:\n"
        "    publisher.publish(String(data=text))\n"
        "except bus.PayloadTooLarge as error:\n"
        '    print(f"{error.size_bytes} bytes, at most {error.limit_bytes}")\n'
        "```",
        (
            *("BusError", "ConfigurationError", "CommandLineError", "StartError"),
            *("ParameterError", "MessageTypeError"),
            *("PayloadTooLarge", "QuotaExceeded", "AccessDenied", "SharedMemoryError", "ConnectionClosed"),
            *("BrokerUnavailable", "ServiceError", "ServiceUnavailable", "ForkError", "ProtocolError"),
            *("LocalProtocolError", "RemoteProtocolError"),
        ),
    ),
}
NAMED = [path for _, paths in GROUPS.values() for path in paths]

_CODE = re.compile(r"\n{2,}((?: {4}.*(?:\n|$)|\n(?= {4}))+)")


def page() -> str:
    public = entries()
    groups = {title: [public[path] for path in paths] for title, (_, paths) in GROUPS.items()}
    if more := [one for path, one in public.items() if "." not in path and path not in NAMED]:
        groups["More"] = more
    contents = [
        f"- [{title}](#{_anchor(title)}): {_links(ones)}".removesuffix(": ") for title, ones in groups.items()
    ]
    parts = [HEAD, "\n".join(contents)]
    for title, ones in groups.items():
        parts.append(f"## {title}")
        if intro := GROUPS[title][0] if title in GROUPS else "":
            parts.append(_filled(intro))
        for one in ones:
            parts += _shown(one, public, "###")
    return "\n\n".join(part.strip("\n") for part in parts) + "\n"


def examples(one: Entry) -> list[str]:
    """The indented blocks of a docstring."""
    return [textwrap.dedent(part).strip() for part in _CODE.split(one.doc)[1::2]]


def _filled(intro: str) -> str:
    """The introduction with the names of packages and types filled in."""
    primitives = [name for name in msg.__all__ if name[0].islower()]
    lists = {"MESSAGES": msg.PACKAGES, "SERVICES": srv.PACKAGES, "PRIMITIVES": primitives}
    for key, names in {**lists, "TESTING": testing.__all__}.items():
        intro = intro.replace(key, ", ".join(f"`{name}`" for name in names))
    return intro


def _title(one: Entry) -> str:
    """The heading of an entry, without the backticks."""
    if "." in one.path:
        return one.path
    return f"module bus.{one.path}" if one.kind == "module" else f"bus.{one.path}"


def _anchor(title: str) -> str:
    """The anchor of a heading, as GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def _links(ones: list[Entry]) -> str:
    return ", ".join(f"[`{one.path}`](#{_anchor(_title(one))})" for one in ones)


def _shown(one: Entry, public: dict[str, Entry], level: str) -> Iterator[str]:
    *kind, name = _title(one).split()
    yield " ".join([level, *kind, f"`{name}`"])
    if one.signature:
        yield f"```python\n{one.signature}\n```"
    yield _text(one, public)
    if one.path == "qos":
        rows = [f"| `{name}` | {qos.in_words(preset)} |" for name, preset in qos.PRESETS.items()]
        yield "\n".join(["| preset | |", "|---|---|", *rows])
    members = [member for member in one.members if member.path not in NAMED]
    if rows := [_row(member, public) for member in members if member.kind == "attribute"]:
        head = "| member | value | |" if one.kind == "enum" else "| attribute | type | |"
        yield "\n".join([head, "|---|---|---|", *rows])
    for member in members:
        if member.kind != "attribute":
            yield from _shown(member, public, "####")


def _row(one: Entry, public: dict[str, Entry]) -> str:
    cells = f"`{one.name}`", f"`{one.signature}`", " ".join(_text(one, public).split())
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def _text(one: Entry, public: dict[str, Entry]) -> str:
    """A docstring as Markdown: indented lines are code, names in backticks are links."""
    owner = one.path.partition(".")[0]

    def link(found: re.Match[str]) -> str:
        name = found[1].removeprefix("bus.")
        may_be_argument = name == found[1] and name.islower() and "." not in name
        other = public.get(f"{owner}.{name}") or (None if may_be_argument else public.get(name))
        if other is None or other is one or other.kind == "attribute":
            return found[0]
        return f"[{found[0]}](#{_anchor(_title(other))})"

    parts = _CODE.split(one.doc)
    for at, part in enumerate(parts):
        if at % 2:
            parts[at] = f"```python\n{textwrap.dedent(part).strip()}\n```"
        else:
            parts[at] = re.sub(r"`([\w.]+)`", link, part).strip()
    return "\n\n".join(part for part in parts if part)


if __name__ == "__main__":
    PAGE.write_text(page())
    print(f"written: {PAGE}")
