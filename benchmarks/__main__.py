"""`python -m benchmarks`: runs benchmarks, prints tables, writes the result as JSON."""

import argparse
import os
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from time import monotonic

import msgspec

from benchmarks import merge, report
from benchmarks.machine import ROOT, look_at_machine
from benchmarks.plan import BENCHMARKS, Plan
from bus_cli.bench.interrupts import deferred, end_on_signals

RESULTS = ROOT / "benchmarks" / "results"
_QUICK_REPETITIONS, _REPETITIONS = 1, 5


def main() -> int:
    """Run the benchmarks; returns 0, 1 if a measurement failed, 2 if a saved result
    can't be continued, or 130 after Ctrl-C."""
    options = _parser().parse_args()
    end_on_signals()
    plan = Plan(options.quick, options.repetitions or (_QUICK_REPETITIONS if options.quick else _REPETITIONS))
    path: Path | None = None
    has_failed = False
    try:
        result = report.Result(
            report.FORMAT, report.began_now(), plan.quick, plan.repetitions, look_at_machine(), []
        )
        if options.into:
            result = merge.base(options.into, result)
        print(result.machine.describe(), end="\n\n", flush=True)
        if plan.quick:
            print("quick: too few messages and repetitions for more than a first look\n", flush=True)
        names = options.only or [one for one in BENCHMARKS if result.section(one) is None]
        if not names:
            print(f"{options.into} has all benchmarks; --only measures some of them again")
        for name in names:
            with deferred():  # an import may swallow an interrupt
                measure: Callable[[Plan], report.Section] = import_module(f"benchmarks.{name}").run
            begin_s, load = monotonic(), os.getloadavg()[0]
            section = measure(plan)
            plan.tell("")
            section = msgspec.structs.replace(section, took_s=round(monotonic() - begin_s), load=load)
            has_failed |= section.has_failures
            print(
                f"{report.render(section)}* took {section.took_s} s, load {load:.2f} at its start\n",
                flush=True,
            )
            result = merge.add(result, section, BENCHMARKS)
            if not options.no_save:
                path = options.into or options.output or RESULTS / report.file_name(result)
                report.save(result, path)  # after each one, because a run takes long
    except report.Unreadable as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"interrupted; {_saved(path) if path else 'nothing saved'}", file=sys.stderr)
        return 130
    if path:
        print(_saved(path))
    return int(has_failed)


def _saved(path: Path) -> str:
    return f"saved as {path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Measure busd with real processes on a bus of their own; see benchmarks/README.md.",
    )
    parser.add_argument("--quick", action="store_true", help="fewer and shorter: about two minutes")
    parser.add_argument("--only", action="append", choices=BENCHMARKS, help="only this one (can be repeated)")
    parser.add_argument("--repetitions", type=_positive, metavar="N", help="how often each case is measured")
    target = parser.add_mutually_exclusive_group()
    target.add_argument("--output", type=Path, metavar="FILE", help="where the JSON goes")
    target.add_argument(
        "--into",
        type=Path,
        metavar="FILE",
        help="add the benchmarks of --only to this result, or all that it does not have yet",
    )
    target.add_argument("--no-save", action="store_true", help="print only")
    return parser


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a number above 0")
    return value


if __name__ == "__main__":
    sys.exit(main())
