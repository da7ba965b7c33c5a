"""`bus web` on the lesson's robot and on a large bus: the first graph, its own cost, and its effect on
others."""

import shutil
import signal
import sys
from collections.abc import Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from time import monotonic, sleep
from typing import NamedTuple
from urllib.parse import urlsplit

import msgspec

from benchmarks.adapters.viewing import View
from benchmarks.cases import Case, Figures, Outcome, interleave
from benchmarks.harness import START_S, Child, Failure, Group
from benchmarks.machine import ROOT
from benchmarks.plan import Plan
from benchmarks.report import Column, Comparison, Row, Section, compare
from bus.errors import ConnectionClosed
from bus.graph import Graph
from bus_cli.query import Query

NAME = "web"
_PROGRAM = "benchmarks.adapters.viewing"
_BUS = [sys.executable, "-m", "bus_cli"]
_LAYERS = ("perception", "cognition", "actuation", "monitoring")
_TOPICS = ["/camera/image_raw", "/imu/data", "/joint_states", "/cmd_vel", "/cmd_vel_applied", "/health"]
_LIMIT_S = 60.0
_SETTLE_S = 2.0
_FIRST, _CROWD = "first graph, the robot", "first graph, 200 nodes and 1,000 topics"
_IDLE, _LOOKED, _IMU, _STOPPED = (
    "nobody looks",
    "a page looks at the robot",
    "IMU in a viewer",
    "a viewer hangs",
)
_COLUMNS = [
    Column("ms", "ms", "lower"),
    Column("us_per_s", "µs CPU/s: bus web", "lower"),
    Column("other_us_per_s", "what it is compared with", "lower"),
    Column("p50_us", "age p50 µs: viewer", "lower"),
    Column("own_p50_us", "subscription", "lower"),
    Column("hz", "robot: messages/s", "higher"),
    Column("hz_before", "without", "higher"),
    Column("lost_share", "lost, per mille", "lower"),
    Column("lost_share_before", "without", "lower"),
    Column("mib", "MiB more", "lower"),
    Column("subscriptions", "subscriptions", "lower"),
]
_NOTES = [
    "first graph: from the address until a headless Chromium has drawn it, by the page's own mark",
    f"{_IDLE}: compared with `bus metrics`, which nobody asks either",
    f"{_LOOKED}: at all its six topics, compared with a `bus topic echo` of each to /dev/null",
    f"{_IMU}: by the stamp in the message; both at the same time",
    f"{_STOPPED}: it has subscribed to the camera, 27 MB/s, and reads nothing",
]


class Web(NamedTuple):
    """A running `bus web`."""

    child: Child
    page: str

    def view(self, who: str, *topics: str, messages: int = 0) -> str:
        """The last argument of a viewer's process."""
        parts = urlsplit(self.page)
        token = parts.query.removeprefix("token=")
        return _text(View(who=who, host=parts.netloc, token=token, topics=[*topics], messages=messages))


def run(plan: Plan) -> Section:
    """Measure the limits that the page and Foxglove's protocol should keep."""
    seconds = plan.choose(4, 15)
    no_browser = _browser_missing()
    cases = [
        Case(_FIRST, partial(measure_first, is_crowd=False), no_browser),
        Case(_CROWD, partial(measure_first, is_crowd=True), no_browser),
        Case(_IDLE, partial(measure_idle, seconds)),
        Case(_LOOKED, partial(measure_robot, seconds)),
        Case(_IMU, partial(measure_imu, plan.choose(600, 3000))),
        Case(_STOPPED, partial(measure_stopped, seconds)),
    ]
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = "The page and Foxglove's protocol: bus web"
    return Section(NAME, title, _COLUMNS, rows, _compare(outcomes), _NOTES)


def _compare(outcomes: dict[str, Outcome]) -> list[Comparison]:
    def values(name: str, key: str, other: str = "") -> list[float]:
        found = outcomes[name].repetitions
        return [one[key] / one[other] if other else one[key] for one in found]

    return [
        *compare(f"{_FIRST}, ms", values(_FIRST, "ms"), at_most=1000.0),
        *compare(f"{_CROWD}, ms", values(_CROWD, "ms"), at_most=1000.0),
        *compare(f"{_IDLE}: subscriptions", values(_IDLE, "subscriptions"), at_most=0.0),
        *compare(
            f"{_IDLE}: µs CPU/s more than bus metrics",
            [one["us_per_s"] - one["other_us_per_s"] for one in outcomes[_IDLE].repetitions],
            at_most=100.0,
        ),
        *compare(
            f"{_LOOKED}: CPU / bus topic echo", values(_LOOKED, "us_per_s", "other_us_per_s"), at_most=1.0
        ),
        *compare(f"{_LOOKED}: messages/s / without", values(_LOOKED, "hz", "hz_before"), at_least=0.99),
        *compare(
            f"{_LOOKED}: lost, per mille more",
            [one["lost_share"] - one["lost_share_before"] for one in outcomes[_LOOKED].repetitions],
            at_most=1.0,
        ),
        *compare(f"{_IMU}: age p50 / subscription", values(_IMU, "p50_us", "own_p50_us"), at_most=3.0),
        *compare(f"{_STOPPED}: MiB", values(_STOPPED, "mib"), at_most=16.0),
    ]


def measure_first(*, is_crowd: bool) -> Figures:
    """A running browser enters the address as soon as it is printed. Raises Failure."""
    with Group() as group:
        group.start_busd()
        browser = group.start_python("browser", "-m", _PROGRAM, _text(View(who="browser")))
        if is_crowd:
            crowd = group.start_python("crowd", "-m", _PROGRAM, _text(View(who="crowd")))
            group.expect(crowd, "ready", within_s=_LIMIT_S)
        else:
            start_robot(group)
        group.expect(browser, "ready", within_s=_LIMIT_S)
        sleep(_SETTLE_S)
        browser.send(start_web(group).page)
        return {"ms": group.expect(browser, "drawn", within_s=_LIMIT_S)["ms"]}


def measure_idle(seconds: float) -> Figures:
    """CPU time without viewers, and the subscriptions of its node. Raises Failure."""
    with Group() as group:
        group.start_busd()
        start_robot(group)
        web = start_web(group)
        metrics = group.start(
            "metrics", *_BUS, "metrics", "--listen", "127.0.0.1:0", stop_signal=signal.SIGTERM
        )
        sleep(_SETTLE_S)
        used = _cpu_us_per_s([web.child, metrics], seconds)
        own = [one for one in _graph(group).subscriptions if one.node.pid == web.child.pid]
        return {"us_per_s": used[0], "other_us_per_s": used[1], "subscriptions": float(len(own))}


def measure_robot(seconds: float) -> Figures:
    """The cost of a page that shows all topics, beside `bus topic echo`, and its effect on the robot."""
    with Group() as group:
        group.start_busd()
        start_robot(group)
        web = start_web(group)
        sleep(_SETTLE_S)
        hz_before, lost_before = _robot(group, seconds)
        page = group.start_python("page", "-m", _PROGRAM, web.view("page", *_TOPICS))
        group.expect(page, "looks", within_s=_LIMIT_S)
        sleep(_SETTLE_S)
        cpu_ns, began_s = web.child.cpu_ns(), monotonic()
        hz, lost = _robot(group, seconds)
        us_per_s = (web.child.cpu_ns() - cpu_ns) / 1e3 / (monotonic() - began_s)
        group.kill(page)
        echoes = [
            group.start(
                f"echo_{number}",
                "sh", "-c", 'exec "$@" > /dev/null', "sh", *_BUS, "topic", "echo", topic,
                stop_signal=signal.SIGTERM,
            )
            for number, topic in enumerate(_TOPICS)
        ]  # fmt: skip
        _await_subscriptions(group, {one.pid for one in echoes})
        sleep(_SETTLE_S)
        return {
            "us_per_s": us_per_s,
            "other_us_per_s": sum(_cpu_us_per_s(echoes, seconds)),
            "hz": hz,
            "hz_before": hz_before,
            "lost_share": lost,
            "lost_share_before": lost_before,
        }


def measure_imu(messages: int) -> Figures:
    """The same messages by Foxglove's protocol and by a subscription. Raises Failure."""
    with Group() as group:
        group.start_busd()
        start_robot(group)
        web = start_web(group)
        view = web.view("foxglove", "/imu/data", messages=messages)
        own = _text(View(who="subscription", topics=["/imu/data"], messages=messages))
        looking = [
            group.start_python(f"look_{at}", "-m", _PROGRAM, one) for at, one in enumerate((view, own))
        ]
        found = [group.expect(one, "ages", within_s=_LIMIT_S)["p50_us"] for one in looking]
        return {"p50_us": found[0], "own_p50_us": found[1]}


def measure_stopped(seconds: float) -> Figures:
    """The growth of the memory of `bus web` in `seconds` with a viewer that reads nothing. Raises Failure."""
    with Group() as group:
        group.start_busd()
        start_robot(group)
        web = start_web(group)
        reader = group.start_python("reader", "-m", _PROGRAM, web.view("foxglove", "/imu/data", messages=50))
        group.expect(reader, "ages", within_s=_LIMIT_S)  # the cost of the first viewer is not a buffer
        before = _own_bytes(web.child)
        stopped = group.start_python("stopped", "-m", _PROGRAM, web.view("stopped", "/camera/image_raw"))
        group.expect(stopped, "stopped", within_s=_LIMIT_S)
        end_s, most = monotonic() + seconds, 0
        while monotonic() < end_s:
            most = max(most, _own_bytes(web.child) - before)
            sleep(0.05)
        return {"mib": most / (1 << 20)}


def start_robot(group: Group) -> list[Child]:
    """Start the four layers; returns when all their topics exist. Raises Failure."""
    layers = [
        group.start(
            one, sys.executable, str(ROOT / "examples" / "robot" / f"{one}.py"), stop_signal=signal.SIGTERM
        )
        for one in _LAYERS
    ]
    end_s = monotonic() + START_S
    while not {one.topic for one in _graph(group).publishers} >= {*_TOPICS}:
        if monotonic() > end_s:
            raise Failure(f"the robot has not all its topics after {START_S:g} s")
        sleep(0.05)
    return layers


def start_web(group: Group) -> Web:
    """Start a `bus web`; returns when it serves. Raises Failure."""
    words = (*_BUS, "web", "--json", "--listen", "127.0.0.1:0")
    child = group.start("web", *words, stop_signal=signal.SIGTERM)
    deadline = monotonic() + START_S
    while True:
        for said in child.events:
            if "page" in said:
                return Web(child, str(said["page"]))
        group.wait_for_news(deadline, "bus web printed no address")


def _robot(group: Group, seconds: float) -> tuple[float, float]:
    """The robot's messages a second, and how many of a thousand messages for it are lost."""
    before = _counts(group)
    began_s = monotonic()
    sleep(seconds)
    published, delivered, lost = (new - old for old, new in zip(before, _counts(group), strict=True))
    return published / (monotonic() - began_s), 1000 * lost / max(1, delivered + lost)


def _counts(group: Group) -> tuple[int, int, int]:
    """Counters of the robot's nodes: published, delivered, lost."""
    graph = _graph(group)
    told = [
        [
            one.statistics
            for one in ends
            if one.node.name in _LAYERS and one.topic in _TOPICS and one.statistics
        ]
        for ends in (graph.publishers, graph.subscriptions)
    ]
    lost = sum(sum(one.dropped.values()) for one in told[1])
    return sum(one.samples for one in told[0]), sum(one.samples for one in told[1]), lost


def _await_subscriptions(group: Group, pids: set[int]) -> None:
    end_s = monotonic() + START_S
    while not {one.node.pid for one in _graph(group).subscriptions} >= pids:
        if monotonic() > end_s:
            raise Failure(f"bus topic echo has not subscribed after {START_S:g} s")
        sleep(0.05)


def _graph(group: Group) -> Graph:
    try:
        query = Query(Path(group.environ["BUSD_SOCKET"]), may_start=False)
        try:
            return query.graph(statistics=True)
        finally:
            query.close()
    except ConnectionClosed as error:
        raise Failure(str(error)) from None


def _cpu_us_per_s(children: Sequence[Child], seconds: float) -> list[float]:
    before, began_s = [one.cpu_ns() for one in children], monotonic()
    sleep(seconds)
    passed_s = monotonic() - began_s
    return [(one.cpu_ns() - old) / 1e3 / passed_s for one, old in zip(children, before, strict=True)]


def _own_bytes(child: Child) -> int:
    """Its own memory, without mapped rings of others."""
    for line in Path(f"/proc/{child.pid}/status").read_text().splitlines():
        if line.startswith("RssAnon:"):
            return int(line.split()[1]) * 1024
    raise Failure(child.describe_end())


def _browser_missing() -> str:
    if shutil.which("chromium") is None or shutil.which("chromedriver") is None:
        return "no chromium with its driver"
    return "" if find_spec("selenium") else "no selenium"


def _text(view: View) -> str:
    return msgspec.json.encode(view).decode()
