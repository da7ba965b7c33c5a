"""`bus top --once` and `--json`: output without a screen and without an event loop."""

import os
import select
import time
from collections.abc import Generator
from pathlib import Path
from time import monotonic, monotonic_ns
from typing import Any

from msgspec import structs, to_builtins

from bus.errors import BrokerUnavailable, ConnectionClosed
from bus_cli.output import complain, reader
from bus_cli.query import Query
from bus_cli.top.columns import BY_TOPIC, sums_text
from bus_web.model import Model
from bus_web.rows import EndpointRow, TopicRow

__all__ = ["looks", "record", "report"]

_LOOKS_FOR_RATES = 3
"""Counters arrive twice a second; a rate needs two arrivals."""


def looks(path: Path, delay_s: float, *, is_once: bool) -> Generator[Model]:
    """Yields the model of the bus every `delay_s` seconds, first when rates are known; `is_once`: only once.

    Without `is_once`, it waits for busd after a restart, for any time. At the beginning it raises the errors
    of `Query`. Raises BrokenPipeError if the reader of the output is gone.
    """

    def describe(name: str, number: str) -> bytes | None:
        try:
            return query.description(name, number)
        except ConnectionClosed:  # the next look reports it
            return None

    query, watch = Query(path), reader()
    model = Model({os.getpid()}, describe)
    number, said = 0, ""
    due_s = monotonic()
    try:
        while True:
            try:
                graph = query.graph(statistics=True)
            except ConnectionClosed as error:
                if is_once:
                    raise
                if (text := str(error)) != said:
                    complain(f"{text}; looking for it again")
                    said = text
                query.close()
                query = _find_again(path, delay_s, watch)
                continue
            said = ""
            model.take(graph, monotonic_ns())
            number += 1
            if number >= _LOOKS_FOR_RATES:
                yield model
                if is_once:
                    return
            due_s = max(due_s + delay_s, monotonic())
            _rest(max(0.0, due_s - monotonic()), watch)
    finally:
        query.close()
        if watch is not None:
            watch.close()


def _find_again(path: Path, delay_s: float, watch: select.epoll | None) -> Query:
    while True:
        try:
            return Query(path)
        except BrokerUnavailable:
            _rest(delay_s, watch)


def _rest(seconds: float, watch: select.epoll | None) -> None:
    if watch is None:
        time.sleep(seconds)
    elif watch.poll(seconds):
        raise BrokenPipeError


def report(model: Model, by: str, width: int | None, *, hidden: bool) -> str:
    """The sums and the table of topics, as text."""
    rows = model.topics(hidden=hidden)
    title, lines = BY_TOPIC.lines(BY_TOPIC.sort(rows, by), width)
    return "\n".join((sums_text(model.sums(rows)), "", title, *(line.text for line in lines)))


def record(model: Model, by: str, *, hidden: bool) -> dict[str, Any]:
    """All values as a JSON record, for programs."""
    rows = model.topics(hidden=hidden)
    return {
        "time": time.time(),
        **structs.asdict(model.sums(rows)),
        "rows": [_topic(model, row) for row in BY_TOPIC.sort(rows, by)],
    }


def _topic(model: Model, row: TopicRow) -> dict[str, Any]:
    endpoints = model.endpoints(row.topic)
    names = {one.id: one.node for one in endpoints}
    found: dict[str, Any] = to_builtins(row)
    del found["history"], found["lost_history"]
    return {
        "topic": found.pop("topic"),
        **found,
        "lost": row.lost,
        "endpoints": [_endpoint(one) for one in endpoints],
        "no_match": [
            {
                "publisher": names.get(pair.publisher, ""),
                "subscription": names.get(pair.subscription, ""),
                "reason": pair.reason,
            }
            for pair in model.pairs(row.topic)
            if not pair.route
        ],
    }


def _endpoint(row: EndpointRow) -> dict[str, Any]:
    found: dict[str, Any] = to_builtins(row)
    for name in ("id", "node_id", "topic", "lost_history"):
        del found[name]
    qos = {name: to_builtins(getattr(row.qos, name)) for name in row.qos.__struct_fields__}
    return {**found, "lost": row.lost, "qos": qos}
