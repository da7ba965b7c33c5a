"""`python -m benchmarks.soak`: runs a steady load for a long time, and checks for growth and losses.

`benchmarks/soaking/load.py` has the load, and `benchmarks/soaking/slope.py` the definition of growth. At the
end it writes tables, a result as JSON and a picture. The exit code is 1 if there is growth, or a forbidden
loss.
"""

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from time import monotonic, sleep

import msgspec

from benchmarks import report
from benchmarks.harness import START_S, Child, Event, Failure, Group
from benchmarks.machine import ROOT, Machine, look_at_machine
from benchmarks.soaking import tables
from benchmarks.soaking.histogram import Histogram
from benchmarks.soaking.load import LISTENERS, TALKERS, VISITORS, Part
from benchmarks.soaking.record import Interval, Record, Totals
from benchmarks.soaking.usage import QUANTITIES, usage_of
from benchmarks.systems import no_shared_memory
from bus_cli.bench.interrupts import end_on_signals

RESULTS = ROOT / "benchmarks" / "results"
_LIST = (sys.executable, "-m", "bus_cli", "topic", "list")
_INTERVALS, _LEAST_S, _MOST_S = 360, 0.25, 10.0
"""The wanted number of intervals of a run, and the least and greatest length of one."""
_QUERY_S = 5.0
_TELL_S = 60.0
_SETTLE_S = 20.0
_LOOK_S = 0.05


class Result(msgspec.Struct, frozen=True):
    """The saved result of a soak. `quantities` names the values in `Interval.usage`."""

    began: str
    seconds: float
    machine: Machine
    quantities: list[str]
    published: dict[str, int]
    totals: dict[str, Totals]
    failures: list[str]
    intervals: list[Interval]


def main() -> int:
    """Run the soak; returns 0, 1 after growth, a loss or a failure, or 130 after Ctrl-C."""
    options = _parser().parse_args()
    end_on_signals()
    seconds = options.seconds or 60.0 * options.minutes
    record = Record()
    try:
        began, machine = report.began_now(), look_at_machine()
        print(machine.describe(), end="\n\n", flush=True)
        with Group() as group:
            Soak(group, record, seconds).run()
    except Failure as error:
        record.failures.append(str(error))
    except KeyboardInterrupt:
        print("interrupted; nothing saved", file=sys.stderr)
        return 130
    if not record.intervals:
        print(tables.failures_text(record.failures))
        return 1
    judged = record.judge(QUANTITIES)
    record.failures += [
        f"{one.process} grows: {one.quantity.name} by {tables.slope_text(one)} an hour"
        for one in judged
        if one.verdict == "grows"
    ]
    print(_summary(record), tables.usage_table(judged), tables.latency_table(record), sep="\n\n")
    print("", tables.account_table(record), "", sep="\n")
    if not options.no_save:
        names = [quantity.name for quantity in QUANTITIES]
        result = Result(
            began,
            seconds,
            machine,
            names,
            record.published,
            record.totals,
            record.failures,
            record.intervals,
        )
        _save(result, record, options.output or RESULTS)
    print(tables.failures_text(record.failures) or "nothing grew, nothing was lost that must not be")
    return 1 if record.failures else 0


class Soak:
    """One run. All its findings go to `record`. Raises Failure if a process does not work as expected."""

    def __init__(self, group: Group, record: Record, seconds: float) -> None:
        self._group = group
        self._record = record
        self._seconds = seconds
        self._every_s = min(max(seconds / _INTERVALS, _LEAST_S), _MOST_S)
        self._children: dict[str, Child] = {}

    def run(self) -> None:
        """Start all processes, watch them, and check at the end that the counters add up."""
        self._start()
        begin_s = monotonic()
        for name in (*TALKERS, *LISTENERS, *VISITORS):
            self._children[name].send("go")
        next_query_s, next_word_s = begin_s, begin_s + _TELL_S
        count = max(1, round(self._seconds / self._every_s))
        for number in range(1, count + 1):
            sleep(max(0.0, begin_s + number * self._every_s - monotonic()))
            interval = self._look(monotonic() - begin_s)
            if monotonic() >= next_query_s:
                next_query_s = monotonic() + _QUERY_S
                self._query()
            if monotonic() >= next_word_s:
                next_word_s += _TELL_S
                self._say(interval)
        self._settle()

    # --- start

    def _start(self) -> None:
        self._children["busd"] = self._group.start_busd()
        listeners = [self._launch(name) for name in LISTENERS]
        talkers = [self._launch(name) for name in TALKERS]
        visitors = [self._launch(name) for name in VISITORS]
        for child in (*listeners, *visitors):
            self._group.expect(child, "ready", within_s=START_S)
        routes: list[str] = []
        for child in talkers:
            routes += self._group.expect(child, "ready", within_s=START_S)["routes"]
        why_not = no_shared_memory()
        if not why_not and "shm" not in routes:
            raise Failure("no match goes by shared memory, which this machine has")
        counts = ", ".join(f"{routes.count(route)} by {route}" for route in sorted(set(routes)))
        print(f"{len(self._children)} processes, matches: {counts}", flush=True)
        if why_not:
            print(f"all by socket: {why_not}", flush=True)
        print(f"{self._seconds:g} s, a look every {self._every_s:g} s", flush=True)

    def _launch(self, name: str) -> Child:
        environ = {"BUS_ROUTE": "socket"} if name.startswith("socket") else {}
        arguments = ("-m", "benchmarks.soaking.roles", msgspec.json.encode(Part(name)).decode())
        child = self._group.start(name, sys.executable, *arguments, environ=environ)
        self._children[name] = child
        return child

    # --- run

    def _look(self, at_s: float) -> Interval:
        """The activity of all processes since the last look, and their resources."""
        ages: dict[str, list[Histogram]] = {}
        for name in TALKERS:
            self._ask(name)
        for name in LISTENERS:
            self._note_listener(name, ages)
        for name in VISITORS:
            self._note_faults(name, self._ask(name))
        usage = {name: tuple(usage_of(child)) for name, child in self._children.items()}
        return self._record.note_interval(at_s, ages, usage)

    def _ask(self, name: str) -> Event:
        child = self._children[name]
        child.send("report")
        return self._group.expect(child, "interval", within_s=START_S)

    def _note_listener(self, name: str, ages: dict[str, list[Histogram]]) -> None:
        event = self._ask(name)
        self._note_faults(name, event)
        for group, found in event["ages"].items():
            counts = {int(bucket): count for bucket, count in found["counts"].items()}
            ages.setdefault(group, []).append(Histogram(counts, found["max_ns"]))
        for ear, totals in event["totals"].items():
            self._record.totals[f"{name}, {ear}"] = msgspec.convert(totals, Totals)

    def _note_faults(self, name: str, event: Event) -> None:
        self._record.failures += [f"{name}: {fault}" for fault in event["faults"]]

    def _query(self) -> None:
        """Run `bus topic list`, as a user would."""
        child = self._group.start("bus_topic_list", *_LIST, ends=True)
        self._group.wait(child, within_s=START_S)
        self._group.let_go(child)
        self._record.queries += 1

    def _say(self, interval: Interval) -> None:
        found = {group: one for group, one in interval.latency.items() if group.endswith(" 100")}
        texts = [f"{tables.label(group)} p99 {report.number(one.p99)} µs" for group, one in found.items()]
        resident = f"busd {interval.usage['busd'][0]:.1f} MiB"
        print(f"{interval.at_s / 60:5.1f} min  {resident}, {', '.join(texts)}", flush=True)

    # --- end

    def _settle(self) -> None:
        """No talker publishes any more, so all published messages must soon be delivered or dropped."""
        record = self._record
        for name in VISITORS:
            event = self._stop(name)
            self._note_faults(name, event)
            record.visits += event["visits"]
            record.visited += event["heard"]
        for name in TALKERS:
            for topic, count in self._stop(name)["published"].items():
                record.published[topic] = record.published.get(topic, 0) + count
        deadline_s = monotonic() + _SETTLE_S
        ages: dict[str, list[Histogram]] = {}
        while True:
            for name in LISTENERS:
                self._note_listener(name, ages)
            is_open = any(one.queued or _missing(record, one) for one in record.totals.values())
            if not is_open or monotonic() > deadline_s:
                break
            sleep(_LOOK_S)
        record.failures += record.open_accounts()

    def _stop(self, name: str) -> Event:
        child = self._children[name]
        child.send("stop")
        return self._group.expect(child, "stopped", within_s=START_S)


def _missing(record: Record, one: Totals) -> int:
    return record.published.get(one.topic, 0) - one.delivered - one.lost


def _summary(record: Record) -> str:
    published = sum(record.published.values())
    delivered = sum(one.delivered for one in record.totals.values())
    drops = ", ".join(f"{reason}: {count:,}" for reason, count in sorted(record.drops().items())) or "none"
    return (
        f"\n{published:,} messages published, {delivered:,} deliveries to listeners, dropped: {drops}\n"
        f"{record.visits:,} visits of late joiners, which heard {record.visited:,}; {record.queries} listings"
    )


def _save(result: Result, record: Record, folder: Path) -> None:
    stamp = result.began.replace(":", "").replace("-", "")
    path = folder / f"{stamp}-soak.json"
    folder.mkdir(parents=True, exist_ok=True)
    path.write_bytes(msgspec.json.format(msgspec.json.encode(result), indent=1) + b"\n")
    _tell_saved([path])
    try:
        from benchmarks.soaking.picture import draw

        _tell_saved(draw(record, path))
    except ImportError as error:
        print(f"no picture, it needs `pip install -e '.[soak]'`: {error}")


def _tell_saved(paths: Iterable[Path]) -> None:
    for path in paths:
        print(f"saved as {path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.soak",
        description="A steady load on a bus of its own: memory and descriptors must be flat, and latency is "
        "told over time; see benchmarks/README.md.",
    )
    parser.add_argument("--minutes", type=_positive, default=30.0, metavar="N", help="how long (30)")
    parser.add_argument("--seconds", type=_positive, metavar="N", help="the same in seconds")
    parser.add_argument("--output", type=Path, metavar="FOLDER", help="where the JSON and the picture go")
    parser.add_argument("--no-save", action="store_true", help="print only")
    return parser


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value <= 24 * 3600:
        raise argparse.ArgumentTypeError(f"{text} is not a number above 0 and up to 86400")
    return value


if __name__ == "__main__":
    sys.exit(main())
