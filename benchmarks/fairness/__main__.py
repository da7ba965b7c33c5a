"""`python -m benchmarks.fairness`: measures some of its cases, or also the busd of another checkout."""

import argparse
import sys
from pathlib import Path

from benchmarks import report
from benchmarks.fairness import Version, measure
from benchmarks.machine import look_at_machine
from benchmarks.plan import Plan
from bus_cli.bench.interrupts import end_on_signals


def main() -> int:
    """Run the cases; returns 0, 1 if a measurement failed, or 130 after Ctrl-C."""
    options = _parser().parse_args()
    end_on_signals()
    plan = Plan(options.quick, options.repetitions)
    versions = [Version(), *options.busd]

    def is_wanted(name: str) -> bool:
        return not options.case or any(text in name for text in options.case)

    try:
        began, machine = report.began_now(), look_at_machine()
        print(machine.describe(), end="\n\n", flush=True)
        section = measure(plan, versions, is_wanted)
    except KeyboardInterrupt:
        print("interrupted; nothing saved", file=sys.stderr)
        return 130
    plan.tell("")
    print(report.render(section), flush=True)
    if options.output is not None:
        result = report.Result(report.FORMAT, began, plan.quick, plan.repetitions, machine, [section])
        report.save(result, options.output)
    return 1 if section.has_failures else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.fairness",
        description="Measure all cases of the benchmark fairness, or some; see benchmarks/README.md.",
    )
    parser.add_argument("--quick", action="store_true", help="shorter: half a second of each pair")
    parser.add_argument("--case", action="append", metavar="TEXT", help="only those with this in their name")
    parser.add_argument(
        "--busd",
        action="append",
        default=[],
        type=_version,
        metavar="LABEL=PROGRAM",
        help="the program busd of another checkout, measured in turns with ours (can be repeated)",
    )
    parser.add_argument("--repetitions", type=int, default=3, metavar="N", help="of each case (default 3)")
    parser.add_argument("--output", type=Path, metavar="FILE", help="where the JSON goes (default: nowhere)")
    return parser


def _version(text: str) -> Version:
    label, _, program = text.partition("=")
    if not label or not Path(program).is_file():
        raise argparse.ArgumentTypeError(f"{text} is not LABEL=PROGRAM with a program that is there")
    return Version(label, program)


if __name__ == "__main__":
    sys.exit(main())
