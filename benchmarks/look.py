"""`bus top` on a large bus: the cost of a look, with showing it, and the time until the first output."""

import os
import pty
import select
import signal
import sys
from functools import partial
from time import monotonic, monotonic_ns

import msgspec

from benchmarks.adapters.looking import Load
from benchmarks.cases import Case, Figures, interleave
from benchmarks.harness import START_S, Failure, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section, compare
from benchmarks.startup import compiling, measure_program

NAME = "look"
_PROGRAM = "benchmarks.adapters.looking"
_TOPICS = (10, 100, 1000)
_LIMIT_S = 120.0
_SHOWN = b"WHY"
"""The last column's title."""
_BUS = [sys.executable, "-m", "bus_cli"]
_START, _LIST, _IMPORT = "bus top until its table is there", "bus topic list", "import of textual"
_COLUMNS = [
    Column("ms", "ms", "lower"),
    Column("asked_ms", "until busd has answered", "lower"),
    Column("cpu_ms", "CPU ms of bus top", "lower"),
]
_NOTES = [
    "a look: busd is asked for the graph and all counters, which have all changed; the model, the rows and "
    "the screen of 160 x 50 are made anew",
]


def run(plan: Plan) -> Section:
    """Measure looks at buses of several sizes, and the start."""
    looks = plan.choose(5, 20)
    cases = [Case(_look(topics), partial(measure_looks, topics, looks)) for topics in _TOPICS]
    cases += [
        Case(_START, measure_start),
        Case(_LIST, partial(measure_program, [*_BUS, "topic", "list"], on_bus=True)),
        Case(
            _IMPORT, partial(measure_program, [sys.executable, "-c", "import textual.app, textual.widgets"])
        ),
    ]
    with compiling():
        interleave(cases[len(_TOPICS) :], 1)  # compiles all modules
        outcomes = interleave(cases, plan.repetitions, lambda text: plan.tell(f"{NAME} {text}"))
    large = [one["ms"] for one in outcomes[_look(_TOPICS[-1])].repetitions]
    comparisons = compare(f"{_look(_TOPICS[-1])}, ms", large, at_most=50.0)
    parts = (outcomes[name].repetitions for name in (_START, _LIST, _IMPORT))
    ratios = [
        start["ms"] / (listing["ms"] + imported["ms"])
        for start, listing, imported in zip(*parts, strict=False)
    ]
    comparisons += compare(f"{_START} / {_LIST} and {_IMPORT}", ratios, at_most=3.0)
    rows = [Row.of(outcomes[case.name]) for case in cases]
    return Section(NAME, "A look at the bus: bus top", _COLUMNS, rows, comparisons, _NOTES)


def measure_looks(topics: int, looks: int) -> Figures:
    """The median of `looks` looks. Raises Failure."""
    with Group() as group:
        group.start_busd()
        world = group.start_python("world", "-m", _PROGRAM, _text(Load(topics=topics)))
        group.expect(world, "ready", within_s=_LIMIT_S)
        looking = group.start_python("looking", "-m", _PROGRAM, _text(Load(looks=looks)))
        found = group.expect(looking, "looked", within_s=_LIMIT_S)
        return {key: found[key] for key in ("ms", "asked_ms", "cpu_ms")}


def measure_start() -> Figures:
    """The time from the start of the process until the table is on the terminal. Raises Failure."""
    with Group() as group:
        group.start_busd()
        begin_ns = monotonic_ns()
        pid, terminal = pty.fork()
        if not pid:
            os.execvpe(_BUS[0], [*_BUS, "top"], {**group.environ, "TERM": "xterm-256color"})
        try:
            _read_until(terminal, _SHOWN)
            return {"ms": (monotonic_ns() - begin_ns) / 1e6}
        finally:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            os.close(terminal)


def _read_until(terminal: int, wanted: bytes) -> None:
    end_s, seen = monotonic() + START_S, b""
    while wanted not in seen:
        if not select.select([terminal], [], [], max(0.0, end_s - monotonic()))[0]:
            raise Failure(f"bus top showed no table within {START_S:g} s")
        try:
            seen += os.read(terminal, 1 << 16)
        except OSError:
            raise Failure(f"bus top ended: {seen[-200:]!r}") from None


def _look(topics: int) -> str:
    return f"a look at {topics:,} topics"


def _text(load: Load) -> str:
    return msgspec.json.encode(load).decode()
