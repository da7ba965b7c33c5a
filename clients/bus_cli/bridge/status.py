"""`bus bridge status`: the bridges on this bus, their links, routes and message counters."""

from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Iterator
from itertools import groupby

from msgspec import to_builtins

from bus.base.counted import counted
from bus.process.address import socket_path
from bus.vocabulary import DropReason
from bus_bridge.core.status import RouteState
from bus_cli.bridge.remote import Answer, ask_all, services_of_bridges
from bus_cli.exitcodes import EXIT_ERROR
from bus_cli.output import CommandError, complain, print_json, say
from bus_cli.query import get_graph
from bus_cli.stream import run_stream

__all__ = ["lines"]

_COLUMNS = {"way": 3, "taken": 10, "sent": 10, "waiting": 7, "dropped": 8, "lost": 8}
"""Columns and their widths. The topic comes last because it may be long."""
_WIDTH = 79


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "-v",
        "--verbose",
        action="store_true",
        help="show each publisher's route, also routes without a subscription",
    )


def main(args: Namespace) -> int:
    """Print the status; returns 1 if no bridge runs, or if one does not answer."""
    graph = get_graph(args, may_start=False)
    if not services_of_bridges(graph):
        raise CommandError("no bridge runs on this bus; `bus bridge zenoh` and `bus bridge ros2` start one")
    answers = run_stream(ask_all(socket_path(args.socket, args.domain), graph))
    code = 0
    for at, (name, answer) in enumerate(answers.items()):
        if isinstance(answer, str):
            complain(f"{name}: {answer}")
            code = EXIT_ERROR
        elif args.json:
            print_json({"node": name, **to_builtins(answer)})
        else:
            say(("\n" if at else "") + "\n".join(lines(name, answer, is_verbose=args.verbose)))
    return code


def lines(node: str, status: Answer, *, is_verbose: bool = False) -> Iterator[str]:
    """Lines about the bridge with the full node name `node`."""
    namespace = f", namespace {status.namespace}" if status.namespace != "/" else ""
    yield f"{node}: {status.engine}, this bus is {status.bus}{namespace}, up {_duration(status.uptime_s)}"
    yield f"{'':11}  nodes  publishers  subscriptions"
    for title, counts in (("shown here", status.shown_here), ("shown there", status.shown_there)):
        yield f"{title:11}  {counts.nodes:5}  {counts.publishers:10}  {counts.subscriptions:13}"
    if status.repeated:
        yield f"dropped because they came twice: {counted(status.repeated, 'message')}"
    yield ""
    for link in sorted(status.links, key=lambda link: (link.state != "up", link.address)):
        what = ", ".join(text for text in (link.bus, link.text) if text)
        yield f"{link.state:<7}  {link.address}" + (f"  {what}" if what else "")
    if not status.links:
        yield "no link"
    if status.refused:
        yield f"refused  {counted(status.refused, 'connection')}, the last one because: {status.refusal}"
    idle = [] if is_verbose else [one for one in status.routes if _is_idle(one)]
    routes = sorted(
        (one for one in status.routes if is_verbose or not _is_idle(one)),
        key=lambda one: (one.topic, one.direction, one.node),
    )
    if routes:
        yield ""
        yield _row(*_COLUMNS, "topic")
        yield "=" * _WIDTH
    if is_verbose:
        for one in routes:
            yield from _rows([one])
            yield f"     of {one.node or '?'}" + (f" on {one.bus}" if one.bus else "")
    else:
        for _, group in groupby(routes, lambda one: (one.topic, one.direction)):
            yield from _rows([*group])
    if not all(one.counts_lost for one in routes):
        yield ""
        yield "lost -: not counted, because DDS shows no numbers of messages"
    if idle:
        yield ""
        yield f"and {len(idle)} route{'s' if len(idle) > 1 else ''} without a subscription (-v shows them)"


def _is_idle(route: RouteState) -> bool:
    return not (route.is_flowing or route.taken or route.waiting or route.dropped)


def _rows(routes: list[RouteState]) -> Iterator[str]:
    """Sums of all routes of one topic in one direction, and lines about problems."""
    dropped: Counter[str] = Counter()
    for one in routes:
        dropped.update(one.dropped)
    lost = dropped.pop(DropReason.LOST_ON_THE_WAY, 0)
    cells = (
        routes[0].direction,
        *(sum(getattr(one, name) for one in routes) for name in ("taken", "sent", "waiting")),
        dropped.total(),
        lost if all(one.counts_lost for one in routes) else "-",
    )
    yield _row(*cells, routes[0].topic)
    if dropped:
        yield "     dropped: " + ", ".join(f"{reason}: {count}" for reason, count in sorted(dropped.items()))
    if any(one.is_stuck for one in routes):
        yield "     stuck: messages wait for a subscription, and the bridge could send none for seconds"


def _row(way: object, *cells: object) -> str:
    *numbers, topic = cells
    widths = [*_COLUMNS.values()]
    texts = (f"{cell:>{width}}" for cell, width in zip(numbers, widths[1:], strict=True))
    return "  ".join((f"{way:<{widths[0]}}", *texts, str(topic)))


def _duration(seconds: float) -> str:
    minutes, left = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {left} s" if minutes else f"{left} s"
