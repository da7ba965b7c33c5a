"""Recording and replaying: a recorder beside simpler programs with the same messages, a replay beside timers.

Bags and the files for comparison are in memory, if there is a file system for that.
"""

import re
import sys
from collections.abc import Mapping
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic_ns

import msgspec
from msgspec.structs import replace

import bus
from benchmarks import throughput
from benchmarks.adapters.bagging import COUNT, FOLDER, RECORD, WRITE, Instants, Robot, Topics
from benchmarks.cases import Case, Figures, Outcome, interleave
from benchmarks.figures import percentiles
from benchmarks.harness import START_S, Child, Failure, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Comparison, Row, Section, compare
from benchmarks.startup import compiling
from benchmarks.systems import BUS
from benchmarks.versus import against
from benchmarks.work import Work, text_of
from bus.msg.std_msgs import String
from bus_bag.metadata import TopicMetadata
from bus_bag.storage import BagWriter
from bus_cli.bench.figures import bytes_text
from bus_ros.cdr import codec_of

NAME = "bags"
_MODULE = "benchmarks.adapters.bagging"
_SIZES = (64, 1 << 10)
_LONG = 64 << 10
_MEMORY = Path("/dev/shm")
_LIMIT_S = 60.0
_ROBOT = Robot(seconds=4.0, rates={"image": 30.0, "imu": 200.0, "tf": 50.0}, image=6 << 20)
_PACED = Work(size=1 << 10, count=1, warm_up=200, rate=1000.0, subscribers=2, take_by="callback")
_STREAM = Work(size=64, count=1, warm_up=200, rate=100_000.0)
_TOPICS = 100
_COUNTED, _RECORDED, _WRITTEN = "counted", "recorded", "written as it comes"
_STREAMED = f"best effort, {_STREAM.rate:,.0f} messages/s, recorded"
_ROBOT_IS = "a robot"
_BESIDE = "a publisher with one more "
_SUBSCRIPTION, _RECORDER = f"{_BESIDE}subscription", f"{_BESIDE}recorder"
_REPLAY, _TIMER = "a replay", "a timer of the event loop"
_SUBSCRIBED = f"{_TOPICS} topics"
_LATENESS = re.compile(r"Lateness: p50 ([\d.]+) ms, p99 ([\d.]+) ms, max ([\d.]+) ms \((\d+) messages\)")
_COLUMNS = [
    Column("per_s", "messages/s", "higher"),
    Column("per_cpu_s", "per CPU second of the busier process", "higher"),
    Column("lost", "lost", "lower"),
    Column("cpu_taker", "CPU us per message: who takes it", "lower"),
    Column("cpu_s", "CPU s: who takes it", "lower"),
    Column("publish_p50", "us of publish: p50", "lower"),
    Column("publish_p99", "p99", "lower"),
    Column("publish_cpu_p99", "its CPU time: p99", "lower"),
    Column("late_p50", "us late: p50", "lower"),
    Column("late_p99", "p99", "lower"),
    Column("s", "s: all subscribed", "lower"),
]
_NOTES = [
    "64 B, 1 KiB: a flood of String, reliable + keep all, until the last one is counted, by a callback with "
    "raw messages, or is in the file; every run checked: none lost; "
    f"{_WRITTEN}: raw messages by os.write, one by one; on a "
    "machine that others use the rate is what they leave, and that per CPU second tells more",
    f"{bytes_text(_LONG)}: the same flood",
    f"{_STREAMED}: {_STREAM.size} B, with the recorder's own profile",
    f"{_ROBOT_IS}: images of {bytes_text(_ROBOT.image)} at 30 Hz, an IMU at 200 Hz, transforms at 50 Hz; "
    "written as it comes: raw messages by os.write, one by one",
    f"{_BESIDE}...: how long each call takes of a publisher of 1 KiB at {_PACED.rate:,.0f} Hz that has one "
    "subscription already",
    f"{_REPLAY}: what `bus bag play -v` says of its lateness; the timer: of uvloop, for the same instants",
    f"{_SUBSCRIBED}: from the word to begin, to a recorder that has imported all, until the last publisher "
    "has its subscription",
]


def run(plan: Plan) -> Section:
    """Measure each case beside its reference."""
    missing = BUS.missing() or ("" if find_spec("mcap") else "mcap is not installed")
    cases: list[Case] = []
    for size in _SIZES:
        count = plan.choose(100_000, 300_000)
        for what, way in ((_COUNTED, COUNT), (_WRITTEN, WRITE), (_RECORDED, RECORD)):
            work = Work(size=size, count=count, warm_up=count // 10, publish_by="publish", take_by=way)
            cases.append(Case(_flood(size, what), partial(measure_flood, work), series=what, at=size))
    for what, way in ((_WRITTEN, WRITE), (_RECORDED, RECORD)):
        count = plan.choose(2_000, 6_000)
        work = Work(size=_LONG, count=count, warm_up=count // 10, publish_by="publish", take_by=way)
        cases.append(Case(_flood(_LONG, what), partial(measure_flood, work), series=what, at=_LONG))
    stream = replace(_STREAM, count=plan.choose(100_000, 300_000), take_by=RECORD)
    cases.append(Case(_STREAMED, partial(measure_stream, stream)))
    for what, way in ((_WRITTEN, COUNT), (_RECORDED, RECORD)):
        robot = replace(_ROBOT, seconds=plan.choose(2, 4), take_by=way)
        cases.append(Case(f"{_ROBOT_IS}, {what}", partial(measure_robot, robot)))
    for what, way in ((_SUBSCRIPTION, COUNT), (_RECORDER, RECORD)):
        paced = replace(_PACED, count=plan.choose(2_000, 5_000))
        cases.append(Case(what, partial(measure_publisher, paced, way)))
    instants = Instants(plan.choose(1_000, 5_000), 1000.0)
    cases.append(Case(_REPLAY, partial(measure_replay, instants)))
    cases.append(Case(_TIMER, partial(measure_timer, instants)))
    cases.append(Case(_SUBSCRIBED, partial(measure_topics, Topics(_TOPICS))))
    cases = [one._replace(missing=missing) for one in cases]
    with compiling():
        outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = "Bags: recording and replaying"
    return Section(NAME, title, _COLUMNS, rows, comparisons(outcomes), _NOTES)


def comparisons(outcomes: Mapping[str, Outcome]) -> list[Comparison]:
    """The ratio of each case to its reference."""
    found: list[Comparison] = []
    for size in _SIZES:
        ours, theirs = _flood(size, _RECORDED), _flood(size, _COUNTED)
        found += against(outcomes, ours, theirs, "per_s", at_least=0.6, label=_COUNTED)
        found += against(outcomes, ours, theirs, "per_cpu_s", label=_COUNTED)
        found += against(outcomes, ours, _flood(size, _WRITTEN), "per_s", label=_WRITTEN)
    ours, theirs = _flood(_LONG, _RECORDED), _flood(_LONG, _WRITTEN)
    found += against(outcomes, ours, theirs, "per_s", at_least=0.6, label=_WRITTEN)
    ours = f"{_ROBOT_IS}, {_RECORDED}"
    found += against(outcomes, ours, f"{_ROBOT_IS}, {_WRITTEN}", "cpu_s", at_most=1.5, label=_WRITTEN)
    for name in (_STREAMED, ours):
        if name in outcomes:
            lost = [one["lost"] for one in outcomes[name].repetitions]
            found += compare(f"{name}: messages lost", lost, at_most=0.0)
    for key in ("publish_p50", "publish_p99", "publish_cpu_p99"):
        goal = 1.2 if key == "publish_p99" else None
        found += against(outcomes, _RECORDER, _SUBSCRIPTION, key, at_most=goal, label="subscription")
    found += against(outcomes, _REPLAY, _TIMER, "late_p99", at_most=3.0, label=_TIMER)
    if _SUBSCRIBED in outcomes:
        took = [one["s"] for one in outcomes[_SUBSCRIBED].repetitions]
        found += compare(f"s until {_TOPICS} topics are subscribed", took, at_most=0.3)
    return found


def _flood(size: int, what: str) -> str:
    return f"{bytes_text(size)}, {what}"


def _in_memory() -> "TemporaryDirectory[str]":
    return TemporaryDirectory(prefix="bench-bags-", dir=_MEMORY if _MEMORY.is_dir() else None)


def _start(group: Group, role: str, work: msgspec.Struct, *, is_ready: bool = True) -> Child:
    child = group.start_python(role, "-m", _MODULE, role, msgspec.json.encode(work).decode())
    if is_ready:
        group.expect(child, "ready", within_s=START_S)
    return child


def measure_flood(work: Work) -> Figures:
    """A flood that is recorded or counted. Raises Failure if a message was lost."""
    with _in_memory() as folder:
        publisher = "benchmarks.adapters.bus_string"
        system = BUS._replace(module=_MODULE, publisher=publisher, environ={FOLDER: folder})
        found = throughput.measure(system, work)
    busiest_s = max(found["cpu_publisher"], found["cpu_subscriber"])
    return {
        "per_s": found["per_s"],
        "per_cpu_s": 100_000 / busiest_s,
        "cpu_taker": found["cpu_subscriber"] * 10,
    }


def measure_stream(work: Work) -> Figures:
    """Messages at a steady rate, recorded with best effort."""
    with _in_memory() as folder, Group() as group:
        group.environ[FOLDER] = folder
        group.start_busd()
        recorder = _start(group, "subscriber", work)
        publisher = _start(group, "publisher", work)
        before_ns = recorder.cpu_ns()
        publisher.send("go")
        group.expect(publisher, "sent", within_s=_LIMIT_S)
        recorder.send("report")
        received = group.expect(recorder, "received", within_s=START_S)
        cpu_s = (recorder.cpu_ns() - before_ns) / 1e9
    return {"lost": work.total - received["count"], "cpu_taker": cpu_s * 1e6 / work.total}


def measure_robot(robot: Robot) -> Figures:
    """The messages of a robot, recorded or written."""
    with _in_memory() as folder, Group() as group:
        group.environ[FOLDER] = folder
        group.start_busd()
        taker = _start(group, "robots_taker", robot)
        publisher = _start(group, "robot", robot)
        taker.send("look")
        group.expect(taker, "warm", within_s=START_S)
        before_ns = taker.cpu_ns()
        publisher.send("go")
        group.expect(publisher, "sent", within_s=_LIMIT_S)
        taker.send("report")
        received = group.expect(taker, "received", within_s=START_S)
        cpu_s = (taker.cpu_ns() - before_ns) / 1e9
    return {
        "lost": robot.total - received["count"],
        "cpu_taker": cpu_s * 1e6 / robot.total,
        "cpu_s": cpu_s,
    }


def measure_publisher(work: Work, way: str) -> Figures:
    """The duration of a publisher's calls."""
    with _in_memory() as folder, Group() as group:
        group.environ[FOLDER] = folder
        group.start_busd()
        _start(group, "listener", work)
        beside = group.start_python(
            "beside", "-m", _MODULE, "subscriber", msgspec.json.encode(replace(work, take_by=way)).decode()
        )
        group.expect(beside, "ready", within_s=START_S)
        publisher = _start(group, "publisher", work)
        before_ns = beside.cpu_ns()
        publisher.send("go")
        sent = group.expect(publisher, "sent", within_s=_LIMIT_S)
        cpu_s = (beside.cpu_ns() - before_ns) / 1e9
    found, cpu = (percentiles(sent[key], scale=1e-3) for key in ("took_ns", "cpu_ns"))
    return {
        "publish_p50": found["p50"],
        "publish_p99": found["p99"],
        "publish_cpu_p99": cpu["p99"],
        "cpu_taker": cpu_s * 1e6 / work.total,
    }


def measure_replay(instants: Instants) -> Figures:
    """The lateness that `bus bag play` reports. Raises Failure if it did not play all messages."""
    with _in_memory() as folder, Group() as group:
        bag = Path(folder) / "bag"
        write_bag(bag, instants)
        group.start_busd()
        _start(group, "listener", Work(size=64, count=0, warm_up=0))
        command = (sys.executable, "-m", "bus_cli", "bag", "play", "-v", "--disable-keyboard-controls")
        player = group.start("player", *command, str(bag), ends=True)
        group.wait(player, within_s=_LIMIT_S)
        said = _LATENESS.search((group.folder / "player.log").read_text())
    if said is None or int(said[4]) != instants.count:
        raise Failure(f"the replay said {said and said[0]!r} of {instants.count} messages")
    return {"late_p50": float(said[1]) * 1e3, "late_p99": float(said[2]) * 1e3}


def write_bag(folder: Path, instants: Instants) -> None:
    """Write a bag with a message at each instant."""
    codec = codec_of(bus.MessageSchema.of(String))
    writer = BagWriter(folder)
    topic = TopicMetadata("/bench", codec.type_name, "cdr", (bus.QoSProfile(1000),), codec.type_hash)
    channel = writer.add_topic(topic, codec.definition)
    data = codec.encode(msgspec.msgpack.encode(String(data=text_of(64))))
    for number in range(instants.count):
        at_ns = 10**18 + int(number * 1e9 / instants.rate)
        writer.write(channel, at_ns, at_ns, number, data)
    writer.close()


def measure_timer(instants: Instants) -> Figures:
    """The lateness of timers without work."""
    with Group() as group:
        child = _start(group, "timer", instants)
        child.send("go")
        late = group.expect(child, "late", within_s=_LIMIT_S)["late_ns"]
    found = percentiles(late, scale=1e-3)
    return {"late_p50": found["p50"], "late_p99": found["p99"]}


def measure_topics(topics: Topics) -> Figures:
    """The time from a recorder's start until it has subscribed to all topics."""
    with _in_memory() as folder, Group() as group:
        group.environ[FOLDER] = folder
        group.start_busd()
        publisher = _start(group, "topics", topics)
        taker = _start(group, "topics_taker", topics)
        before_ns, begin_ns = taker.cpu_ns(), monotonic_ns()
        taker.send("go")
        matched = group.expect(publisher, "matched", within_s=_LIMIT_S)
        cpu_s = (taker.cpu_ns() - before_ns) / 1e9
    return {"s": (matched["at_ns"] - begin_ns) / 1e9, "cpu_s": cpu_s}
