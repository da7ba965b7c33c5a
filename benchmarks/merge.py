"""Continues a saved result: the rest of an interrupted run, or one benchmark measured again.

A report compares the figures of one product on one machine. So this refuses to add figures of another
machine, of other versions or options, or of a changed busd. The files of the benchmarks may have changed.
"""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from benchmarks.compare import differ
from benchmarks.machine import changes_since
from benchmarks.report import Result, Section, Unreadable, load


def base(path: Path, present: Result) -> Result:
    """The saved result to which `present`, a result without sections, adds its figures. Raises Unreadable."""
    saved = load(path)
    if obstacle := obstacle_between(saved, present, changes_since(saved.machine.commit)):
        raise Unreadable(f"{path} can't be continued: {obstacle}")
    return saved


def obstacle_between(saved: Result, present: Result, changed: Sequence[str] | None) -> str:
    """The reason why figures of `present` can't be added to `saved`; empty if they can.

    `changed`: files of the product that have changed since `saved`, or None if git can't tell.
    """
    commit = saved.machine.commit or "unknown"
    if changed is None:
        return f"git does not know the files that it measured, of commit {commit}"
    if changed:
        return f"{changed[0]} has changed since its commit {commit}"
    warnings = differ(saved, present).warnings
    return f"{warnings[0]} (A: the file, B: this run)" if warnings else ""


def add(result: Result, section: Section, order: Sequence[str]) -> Result:
    """`result` with `section`, in place of an older one of this name, sorted by `order`."""
    sections = [one for one in result.sections if one.name != section.name]
    sections.append(section)
    sections.sort(key=lambda one: order.index(one.name) if one.name in order else len(order))
    return msgspec.structs.replace(result, sections=sections)
