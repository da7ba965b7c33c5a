"""`bus doctor`: checks everything that the bus needs, and prints advice for each problem.

A module for each subject yields findings (`finding.py`): ok, warn or fail, with a text and advice.

Invariants:

- No check waits for long, because users run the doctor if a daemon or program hangs.
- `procfs.py` reads data of the kernel, which may be gone or hidden at any time. It does not judge.
- `reports.py` only states facts, for `--report`; `hello.py` is a separate verb.
- `conformance/` tests a client that is not made with this library.
- A finding of `fail` makes the exit code 1. Each `fail` and `warn` has advice, if there is any.

Read first: `finding.py`. Tests: `tests/unit/bus_cli/doctor/`, `tests/system/test_cli_doctor.py`.
"""

import os
from argparse import ArgumentParser, Namespace
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from bus.errors import BusError
from bus.process.address import socket_path
from bus_cli.doctor import bridges, configuration, daemon, machine, place, processes, topics, versions
from bus_cli.doctor.conformance.options import add_arguments as add_conformance_arguments
from bus_cli.doctor.daemon import Seen
from bus_cli.doctor.finding import Finding, fail, ok
from bus_cli.doctor.reports import category_of, reports, text_of
from bus_cli.exitcodes import EXIT_ERROR
from bus_cli.output import print_json, say
from bus_cli.query import NotRunning


def add_arguments(parser: ArgumentParser) -> None:
    parser.epilog = "exit status: 0, or 1 if a check fails"
    group = parser.add_mutually_exclusive_group()
    group.add_argument("-r", "--report", action="store_true", help="Print all reports.")
    group.add_argument(
        "-rf", "--report-failed", action="store_true", help="Print reports of failed checks only."
    )
    parser.add_argument(
        "-ep", "--exclude-packages", action="store_true", help="Exclude package checks or report."
    )
    parser.add_argument(
        "-iw",
        "--include-warnings",
        action="store_true",
        help="Include warnings as failed checks. Warnings are ignored by default.",
    )
    add_conformance_arguments(parser)

    parser.add_argument(
        "--live",
        action="store_true",
        help="Also watch the bus for three seconds: losses, and advice about them",
    )


def main(args: Namespace) -> int:
    if args.conformance or args.story:
        from bus_cli.doctor.conformance import program

        return program.main(args)
    if args.report:
        _print_reports(args, None)
        return 0
    bad = {"fail", "warn"} if args.include_warnings else {"fail"}
    total, failed = 0, list[Finding]()
    for finding in examine(args):  # print each immediately, because some checks take seconds
        _print_finding(args, finding)
        total += 1
        if finding.mark in bad:
            failed.append(finding)
    if not args.json:
        say(_summary(failed, total))
    if args.report_failed and failed:
        _print_reports(args, {category_of(finding) for finding in failed})
    return EXIT_ERROR if failed else 0


def _print_finding(args: Namespace, finding: Finding) -> None:
    if args.json:
        print_json(finding._asdict())
    else:
        advice = f"\n       -> {finding.advice}" if finding.advice else ""
        say(f"[{finding.mark:^4}] {finding.subject}: {finding.text}{advice}")


def _summary(failed: Sequence[Finding], total: int) -> str:
    """The last lines, as in ROS 2."""
    if not failed:
        return f"\nAll {total} checks passed\n"
    names = ", ".join(dict.fromkeys(finding.subject for finding in failed))
    return f"\n{len(failed)}/{total} check(s) failed\n\nFailed modules: {names}"


def _print_reports(args: Namespace, categories: Collection[str] | None) -> None:
    path = socket_path(args.socket, args.domain)
    seen = daemon.reach(path)
    graph, pid = (seen.graph, seen.hello.pid) if isinstance(seen, Seen) else (None, None)
    for report in reports(path, graph, pid, categories=categories):
        if args.exclude_packages and report.category == "package":
            continue
        if args.json:
            items = [{"name": name, "value": value} for name, value in report.items]
            print_json({"report": report.title, "category": report.category, "items": items})
        else:
            say(text_of(report))


def _examine_losses(path: Path) -> Iterator[Finding]:
    from bus_cli.doctor import live

    try:
        yield from live.examine(live.watch(path))
    except BusError as error:
        yield fail("losses", str(error))


def examine(args: Namespace) -> Iterator[Finding]:
    """All findings, the most basic ones first."""
    clocks = machine.ClockWatch()
    charges, pid = None, None
    file, running = None, set[str]()
    try:
        path = socket_path(args.socket, args.domain)
    except BusError as error:
        yield fail("socket", str(error), "choose another path or domain")
    else:
        yield ok("socket", f"{path} (from {place.origin(args)})")
        seen = daemon.reach(path)
        is_default = place.is_default(args)
        yield place.folder(path.parent, is_default=is_default, is_served=isinstance(seen, Seen))
        yield from place.socket_file(path)
        if not isinstance(seen, Seen) or seen.hello.background:  # else its log is where its user sees it
            yield from place.log_file(path)
        yield from daemon.examine(path, seen)
        yield from daemon.others(path)
        if isinstance(seen, NotRunning):
            yield from place.leftovers(path, is_default=is_default)
        if isinstance(seen, Seen):
            yield from configuration.examine(path, seen.hello.pid)
            charges, pid = seen.charges, seen.hello.pid
            file, running = configuration.file_of_daemon(pid), bridges.engines_with_bridges(seen.graph)
            yield from processes.examine(seen)
            yield from topics.examine(seen.graph)
            if args.live:
                yield from _examine_losses(path)
    if not args.exclude_packages:
        yield from versions.examine()
    yield from versions.ros2_program(os.environ.get("PATH", os.defpath).split(os.pathsep))
    yield versions.shared_memory()
    yield from versions.native_core()
    yield from bridges.examine(file, running)
    yield from machine.limits()
    yield from machine.memory(charges.limits if charges else {}, pid)
    yield clocks.finding()
