"""A camera with RGB frames of 1080p, 30 a second, and four readers: latency, CPU time, losses."""

from collections.abc import Mapping
from functools import partial
from time import monotonic

from msgspec.structs import replace

from benchmarks.cases import Case, Figures, Outcome, interleave
from benchmarks.figures import percentiles
from benchmarks.harness import START_S, Child, Failure, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Comparison, Row, Section
from benchmarks.systems import BUS_BYTES, ICEORYX, RCLPY, ROS, ROS_LARGE, ZENOH, System
from benchmarks.versus import against, against_best
from benchmarks.work import IMAGE, Work

NAME = "camera"
READERS = 4
_RATE = 30.0
_FRAME = Work(size=1920 * 1080 * 3, count=1, warm_up=10, rate=_RATE, subscribers=READERS)
_LATE_S = 2.0
"""A frame counts as lost if it has not arrived this long after the due time of the last frame."""
_WAYS: list[tuple[System, dict[str, str]]] = [
    (BUS_BYTES, {"publish_by": "loan", "take_by": "views"}),
    (ICEORYX, {"publish_by": "loan", "take_by": "event"}),
    (ZENOH, {"publish_by": "loan"}),
    (RCLPY, {"publish_by": IMAGE}),
    (ROS, {"publish_by": IMAGE}),
    (ROS_LARGE, {"publish_by": IMAGE}),
]
_ESSENTIAL = (BUS_BYTES, ICEORYX)
_COLUMNS = [
    Column("p50", "µs: p50", "lower"),
    Column("p99", "p99", "lower"),
    Column("max", "max", "lower"),
    Column("lost", "lost %", "lower"),
    Column("cpu_publisher", "CPU ms per frame: publisher", "lower"),
    Column("cpu_reader", "each reader", "lower"),
    Column("cpu_broker", "broker", "lower"),
    Column("late_p99", "sender late, µs: p99", "lower"),
]
_NOTES = [
    f"{_FRAME.size / 1e6:.1f} MB each, to processes that look at the first bytes; latency from the stamp to "
    "the callback, of all readers together; each frame is filled by one copy of the same bytes, after its "
    "stamp",
    "busd, iceoryx2 and zenoh: one field of bytes, filled where it is sent from, losing nothing by their "
    "settings; busd and iceoryx2 are read in place, zenoh's Python copies them out",
    "rclpy: sensor_msgs/Image with the profile for sensor data (best effort, keep last 5), one program on "
    "busd's facade and on ROS 2; a lost frame has no latency, so look at what was lost first",
]


def run(plan: Plan) -> Section:
    """Measure the camera of each system."""
    work = replace(_FRAME, count=plan.choose(30, 100))
    cases = [
        Case(
            name_of(system),
            partial(measure, system, replace(work, gives_turns=system.gives_turns, **way)),
            system.missing(),
            system.name,
            READERS,
            plan.rounds(is_essential=system in _ESSENTIAL),
        )
        for system, way in _WAYS
    ]
    outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = f"A camera: 1080p RGB at {_RATE:g} Hz to {READERS} readers"
    return Section(NAME, title, _COLUMNS, rows, comparisons(outcomes), _NOTES, "readers")


def name_of(system: System) -> str:
    """The name of the system's row."""
    return f"{READERS} readers, {system.name}"


def comparisons(outcomes: Mapping[str, Outcome]) -> list[Comparison]:
    """busd beside all lossless systems, and its facade beside ROS 2."""
    rivals = [name_of(system) for system, _ in _WAYS if system.kind != "ours"]
    found: list[Comparison] = []
    for key in ("p50", "p99", "cpu_publisher", "cpu_reader"):
        found += against_best(outcomes, name_of(BUS_BYTES), rivals, key, at_most=1.0)
    for theirs in (ROS, ROS_LARGE):
        for key in ("p50", "cpu_publisher", "cpu_reader"):
            found += against(outcomes, name_of(RCLPY), name_of(theirs), key, at_most=1.0)
    return found


def measure(system: System, work: Work) -> Figures:
    """Measure one stream. If a stream reached no reader, only its CPU time. Raises Failure if a process
    ended."""
    with Group() as group:
        servers = system.start_servers(group)
        publisher, readers = system.start_fan(group, work, work.subscribers)
        children = (publisher, *readers, *servers)
        before_ns = [child.cpu_ns() for child in children]
        publisher.send("go")
        _wait_for_all(group, readers, monotonic() + work.total / work.rate + _LATE_S)
        after_ns = [child.cpu_ns() for child in children]
        for child in readers:
            child.send("report")
        received = [group.expect(child, "received", within_s=START_S) for child in readers]
    ages = [age for one in received for age in one["age_ns"]]
    late = [late for one in received for late in one["late_ns"]]
    per_frame = 1e6 * work.total
    cpu_ms = [(after - before) / per_frame for before, after in zip(before_ns, after_ns, strict=True)]
    figures = percentiles(ages, scale=1e-3) if ages else {}
    figures |= {"late_p99": percentiles(late, scale=1e-3)["p99"]} if late else {}
    return figures | {
        "lost": 100 - 100 * len(ages) / (work.count * work.subscribers),
        "cpu_publisher": cpu_ms[0],
        "cpu_reader": sum(cpu_ms[1 : 1 + len(readers)]) / len(readers),
        "cpu_broker": sum(cpu_ms[1 + len(readers) :]),
    }


def _wait_for_all(group: Group, readers: list[Child], deadline: float) -> None:
    """Wait until each reader has all frames, at most until `deadline`."""
    for child in readers:
        try:
            group.expect(child, "complete", within_s=max(0.01, deadline - monotonic()))
        except Failure:
            if not child.is_running():
                raise
