"""Runs a plan: one session after the other, and prints the results as text or JSON."""

import secrets
from argparse import Namespace
from collections.abc import Sequence
from time import monotonic
from typing import Any

import msgspec

from bus.base.counted import counted
from bus.process.address import socket_path
from bus.qos import QoSProfile
from bus_cli.bench.figures import Run, bytes_text, plots, tables
from bus_cli.bench.interrupts import end_on_signals
from bus_cli.bench.payload import Payload
from bus_cli.bench.place import Place, find_bus
from bus_cli.bench.plan import Plan
from bus_cli.bench.progress import Bar
from bus_cli.bench.session import Session, worker_environ
from bus_cli.bench.task import Go, Ready, Sent, Task
from bus_cli.exitcodes import EXIT_ERROR
from bus_cli.output import CommandError, complain, print_json, say

__all__ = ["judge", "run_plan"]

_BAR_CELLS = 40


def run_plan(args: Namespace, plan: Plan) -> int:
    """Measure and print; returns the exit code."""
    for size in plan.sizes:
        Payload(plan.type_name, size)  # raises now if the size is impossible
    end_on_signals()
    return _Bench(args, plan).run()


class _Bench:
    def __init__(self, args: Namespace, plan: Plan) -> None:
        self._plan = plan
        self._as_json: bool = args.json
        self._is_plotted: bool = args.plot
        self._path = socket_path(args.socket, args.domain)
        self._runs: list[Run] = []
        self._interrupt: KeyboardInterrupt | None = None

    def run(self) -> int:
        with find_bus(self._path) as place:
            self._introduce(place)
            try:
                with Bar() as bar:
                    for size in self._plan.sizes:
                        for pace in self._plan.paces:
                            self._measure(place, size, pace, bar)
            except KeyboardInterrupt as interrupt:
                self._interrupt = interrupt
                raise
            finally:
                self._report(place)
        return judge(self._plan.qos, self._runs)

    def _measure(self, place: Place, size: int, pace: float, bar: Bar) -> None:
        """Measure one run. After its start, an interruption ends it early, and its results count."""
        plan = self._plan
        task = Task(
            role="",
            socket=place.socket,
            topic=f"/_bench/run_{secrets.token_hex(8)}",
            type_name=plan.type_name,
            size=size,
            rate=pace,
            publishers=plan.publishers,
            subscribers=plan.subscribers,
            qos=plan.qos,
        )
        meter = _Meter(bar, plan.publishers)
        bar.begin(f"{bytes_text(size)}, {f'{pace:,g}/s' if pace else 'flood'}")
        with Session(task, worker_environ(plan.route), meter.progress) as session:
            route = _route(session.start(), plan.route)
            published = 0
            if (go := plan.warm_up(pace)) is not None:
                meter.begin("warm-up", go)
                published = _total(session.publish(go))
                session.settle(published)
            go = plan.measured(pace)
            meter.begin("measures", go)
            try:
                sent = session.publish(go)
            except KeyboardInterrupt as interrupt:
                self._interrupt = interrupt
                sent = session.stop_publishing()
                if not _total(sent):
                    raise
            settled = session.settle(published + _total(sent))
        self._runs.append(Run.of(size, pace, route, sent, settled))
        if self._interrupt is not None:
            raise self._interrupt

    def _introduce(self, place: Place) -> None:
        if self._as_json:
            return
        where = f"the busd at {place.socket} (pid {place.pid})"
        if place.own:
            where = f"a temporary busd, because none listens on {self._path}"
        plan = self._plan
        say(
            f"{Payload(plan.type_name, plan.sizes[0]).name}, {counted(plan.publishers, 'publisher')}, "
            f"{counted(plan.subscribers, 'subscriber')}, {_qos_text(plan.qos)}\non {where}"
        )

    def _report(self, place: Place) -> None:
        if self._as_json and (self._runs or self._interrupt):
            print_json(self._record(place))
        elif self._runs:
            say(f"\n{tables(self._runs)}", end="")
            for line in plots(self._runs, _BAR_CELLS) if self._is_plotted else ():
                say(line)
        if self._interrupt is not None:
            complain("interrupted: this is what was measured so far" if self._runs else "interrupted")

    def _record(self, place: Place) -> dict[str, Any]:
        plan = self._plan
        return {
            "verb": plan.verb,
            "bus": msgspec.to_builtins(place),
            "type": Payload(plan.type_name, plan.sizes[0]).name,
            "publishers": plan.publishers,
            "subscribers": plan.subscribers,
            "qos": {name: getattr(plan.qos, name) for name in QoSProfile.__struct_fields__},
            "warm_up_s": plan.warm_up_s,
            "interrupted": self._interrupt is not None,
            "runs": msgspec.to_builtins(self._runs),
        }


def judge(qos: QoSProfile, runs: Sequence[Run]) -> int:
    """The exit code: an error if messages were lost although `qos` promises no losses."""
    if not qos.is_lossless or all(run.is_complete for run in runs):
        return 0
    complain("messages were lost, although reliable + keep all promises that none is")
    return EXIT_ERROR


class _Meter:
    """Progress of a Go, for the bar."""

    def __init__(self, bar: Bar, publishers: int) -> None:
        self._bar = bar
        self._publishers = publishers
        self._phase = ""
        self._go = Go(count=1, seconds=0.0)
        self._begin_s = 0.0

    def begin(self, phase: str, go: Go) -> None:
        self._phase, self._go, self._begin_s = phase, go, monotonic()
        self._bar.show(phase, 0.0)

    def progress(self, count: int) -> None:
        if self._go.count:
            part = count / (self._go.count * self._publishers)
        else:
            part = (monotonic() - self._begin_s) / self._go.seconds
        self._bar.show(self._phase, min(part, 1.0))


def _route(ready: list[Ready], wanted: str | None) -> str:
    """The route of all matches. Raises CommandError if it is not the `wanted` route."""
    routes = sorted({route for one in ready for route in one.routes})
    if wanted is not None and routes != [wanted]:
        why = next((one.why_socket for one in ready if one.why_socket), "busd chose so")
        raise CommandError(f"--route {wanted}: messages would go by {' and '.join(routes)}: {why}")
    return "+".join(routes)


def _total(sent: list[Sent]) -> int:
    return sum(one.count for one in sent)


def _qos_text(qos: QoSProfile) -> str:
    if qos.is_lossless:
        return "reliable + keep all"
    kept = "keep all" if qos.history == "keep_all" else f"keep last {qos.depth}"
    return f"{qos.reliability.value.replace('_', ' ')} + {kept}"
