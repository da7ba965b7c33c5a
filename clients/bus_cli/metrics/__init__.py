"""`bus metrics`: counters of the bus for Prometheus.

It is a separate program, so busd parses no HTTP: for busd, a scrape is two requests.

    `view.py` (asks busd and bridges) -> `sums.py`, `bridges.py` (`growth.py`) -> `families.py` -> `serve.py`

Invariants:

- A sum only grows, also if endpoints, processes or busd come and go. `sums.py`, `bridges.py` and `growth.py`
  are pure.
- Everything is bounded: names that come and go for months must not fill the memory.
- The server listens on loopback only, and only answers requests for a name of this machine.
- docs/operation.md lists each metric.

Read first: `sums.py`. Tests: `tests/unit/bus_cli/metrics/`, `tests/system/test_cli_metrics.py`.
"""

import sys
from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING

from bus.base.optional import how_to_install
from bus.process.address import socket_path
from bus.process.termination import die_at_interrupt
from bus_cli.metrics.view import View, read_view
from bus_cli.output import CommandError, complain, print_json, say, show
from bus_cli.stream import positive_int
from bus_web.place import Place, parse_address

if TYPE_CHECKING:
    from prometheus_client.registry import CollectorRegistry

_DEFAULT = Place("127.0.0.1", 9464)
_WHY = "metrics name processes and topics, so they are served on loopback only"
_MOST_ROWS = 2000
_LOOK_S = 3600.0
"""Period in which the server checks whether to end. It never has to: a signal ends it at once."""

_EPILOG = f"""\
PLACE is on loopback, which every user of this machine can read. The metrics are listed in docs/operation.md.
Needs prometheus-client: {how_to_install("prometheus-client")}
"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.epilog = _EPILOG
    parser.add_argument(
        "--listen",
        metavar="PLACE",
        type=lambda text: parse_address(text, _DEFAULT, _WHY),
        default=_DEFAULT,
        help=f"address and port, 0 for any (default: {_DEFAULT})",
    )
    parser.add_argument("--once", action="store_true", help="print the metrics and exit")
    parser.add_argument(
        "--max-rows",
        metavar="N",
        type=positive_int,
        default=_MOST_ROWS,
        help=f"rows of a metric, such as topics; more are left out and counted (default: {_MOST_ROWS})",
    )


def main(args: Namespace) -> int:
    """Serve the metrics until a signal comes, or print them `--once`."""
    registry = _registry(args)
    if args.once:
        _print(registry, json=args.json)
        return 0
    from bus_cli.metrics.serve import open_server

    with open_server(args.listen, registry) as server:
        where = f"http://{server.place}/metrics"
        show(f"metrics at {where}", {"listening": where}, as_json=args.json)
        sys.stdout.flush()
        # There is nothing to clean up. As an exception, a Ctrl-C during a finalizer would be lost.
        die_at_interrupt()
        server.serve_forever(_LOOK_S)
    return 0


def _print(registry: "CollectorRegistry", *, json: bool) -> None:
    from prometheus_client.exposition import generate_latest

    if not json:
        say(generate_latest(registry).decode(), end="")
        return
    for family in registry.collect():
        for sample in family.samples:
            print_json({"name": sample.name, "labels": sample.labels, "value": sample.value})


def _registry(args: Namespace) -> "CollectorRegistry":
    try:
        from prometheus_client.registry import CollectorRegistry

        from bus_cli.metrics.families import BusCollector
    except ImportError as error:
        advice = how_to_install("prometheus-client")
        raise CommandError(f"metrics need prometheus-client ({error}): {advice}") from None
    path = socket_path(args.socket, args.domain)
    last_reason = ""

    def poll_and_report() -> View | str:
        nonlocal last_reason
        seen = read_view(path)
        reason = "" if isinstance(seen, View) else seen
        if reason != last_reason:
            complain(reason or f"busd answers at {path}")
        last_reason = reason
        return seen

    registry = CollectorRegistry()
    registry.register(
        BusCollector(poll_and_report, most_rows=args.max_rows, hidden=args.include_hidden_topics)
    )
    return registry
