"""Losses that happen while the doctor watches, and advice about earlier ones.

`watch` looks at the bus for some seconds; `examine` is pure and judges the results.
"""

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from bus.base.counted import counted
from bus_cli.doctor.finding import Finding, ok, warn
from bus_cli.query import Query
from bus_web.model import Model
from bus_web.rows import EndpointRow

__all__ = ["LOOKS", "examine", "watch"]

LOOKS = 4
"""One each second: rates need two reports, and processes report twice a second."""
_MOST = 10
"""Most lines about losses."""


def watch(path: Path, rest: Callable[[float], None] = time.sleep) -> Model:
    """Look at the bus for three seconds. Raises the errors of Query."""
    with Query(path) as query:
        model = Model({os.getpid()}, query.description)
        for number in range(LOOKS):
            if number:
                rest(1.0)
            model.take(query.graph(statistics=True), time.monotonic_ns())
    return model


def examine(model: Model) -> Iterator[Finding]:
    """A finding for each subscription that loses messages, or has lost some and there is advice."""
    rows = [row for row in model.all_endpoints() if row.kind == "subscription"]
    losing = sorted((row for row in rows if row.lost_per_s > 0), key=lambda row: -row.lost_per_s)
    advised = [row for row in rows if row.lost_per_s <= 0 and row.advice]
    found = [*losing, *advised]
    for row in found[:_MOST]:
        yield warn("losses", _text(row), row.advice or f"bus topic info -v {row.topic}")
    if len(found) > _MOST:
        yield warn("losses", f"{counted(len(found) - _MOST, 'further subscription')} with losses", "bus top")
    if not losing:
        yield ok("losses", f"{counted(len(rows), 'subscription')}, none lost a message in {LOOKS - 1} s")


def _text(row: EndpointRow) -> str:
    reason = max(row.dropped, key=row.dropped.__getitem__, default="")
    if row.lost_per_s > 0:
        return f"{row.topic}: {row.node} loses {row.lost_per_s:.3g} messages a second ({reason})"
    return f"{row.topic}: {row.node} has lost {row.lost} messages ({reason})"
