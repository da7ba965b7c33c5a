"""`bus top`: topics and nodes with their rates and losses, live.

    bus --> bus_web.model --> `state.py` (the view) --> `columns.py`, `figures.py` --> `table.py` (lines)
                                                                   `screen.py` (textual), `plain.py` <-+

Invariants:

- `state.py`, `columns.py`, `figures.py` and `table.py` are pure, so the screen is tested without a terminal.
- textual is imported only for the screen. --once and --json need neither textual nor an event loop.
- The page in a browser shows the same rows: they come from `bus_web`.
- A terminal with a locale other than UTF-8 gets ASCII (`ascii_text.py`), a dumb one gets plain tables.

Read first: `state.py`. Tests: `tests/unit/bus_cli/top/`, `tests/system/test_cli_top.py`.
"""

import os
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace

from bus.base.optional import how_to_install
from bus.process.address import socket_path
from bus_cli.completion import completed_by
from bus_cli.output import CommandError, print_json, say
from bus_cli.stream import positive
from bus_cli.top.ascii_text import ascii_text, is_ascii_only, is_dumb
from bus_cli.top.columns import SORT_KEYS

_EPILOG = f"""\
Keys: s next column to sort by, r reverse, / filter, h hidden ones, n by node, Enter live values, space pause,
? help, q quit. Without --once or --json, bus top needs a terminal and textual:
{how_to_install("textual")}
"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.epilog = _EPILOG
    parser.add_argument(
        "-d", "--delay", metavar="S", type=_delay, default=1.0, help="refresh period in seconds (default: 1)"
    )
    completed_by(
        parser.add_argument(
            "--sort",
            metavar="KEY",
            type=_sort_key,
            default="topic",
            help=f"column to sort by: {', '.join(SORT_KEYS)} (default: topic)",
        ),
        lambda **_: SORT_KEYS,
    )
    parser.add_argument("--once", action="store_true", help="print the table once rates are known, and exit")


def main(args: Namespace) -> int:
    """Show the bus until `q` or Ctrl-C."""
    if args.once or args.json or (is_dumb(os.environ) and sys.stdout.isatty()):
        from bus_cli.top.plain import looks, record, report

        hidden = args.include_hidden_topics
        for model in looks(socket_path(args.socket, args.domain), args.delay, is_once=args.once):
            if args.json:
                print_json(record(model, args.sort, hidden=hidden))
            else:
                text = report(model, args.sort, _width(), hidden=hidden)
                say(ascii_text(text) if is_ascii_only(os.environ) else text)
                if not args.once:  # tables follow each other
                    say("")
            sys.stdout.flush()
        return 0
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise CommandError("bus top needs a terminal; without one, use --once or --json")
    try:
        from bus_cli.top.screen import run
    except ImportError as error:
        advice = how_to_install("textual")
        raise CommandError(
            f"bus top needs textual ({error}): {advice}; --once and --json work without it"
        ) from None
    return run(args)


def _width() -> int | None:
    """Width of the terminal, 80 if it does not tell; None if the output is not a terminal."""
    return (os.get_terminal_size(sys.stdout.fileno()).columns or 80) if sys.stdout.isatty() else None


def _delay(text: str) -> float:
    """Read a period in seconds, for argparse."""
    seconds = positive(text)
    if not 0.1 <= seconds <= 3600:
        raise ArgumentTypeError(f"the period must be from 0.1 to 3600 s, not {text}")
    return seconds


def _sort_key(text: str) -> str:
    """Read a key to sort by, for argparse."""
    key = text.lower()
    if key not in SORT_KEYS:
        from bus.base.suggest import did_you_mean

        raise ArgumentTypeError(
            f"no column {text!r} to sort by: {', '.join(SORT_KEYS)}{did_you_mean(key, SORT_KEYS)}"
        )
    return key
