"""Options for messages as text: the parts of a message that a verb prints, and their format."""

from argparse import ArgumentParser, Namespace

from bus_cli.render import Budget, View
from bus_cli.stream import unsigned_int

__all__ = ["MOST_VALUES", "add_view_arguments", "view_of"]

TRUNCATE_LENGTH = 128
MOST_VALUES = 100_000
"""Most values of one message as YAML, if its arrays are truncated: they take seconds and some 100 MiB."""


def add_view_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--csv",
        action="store_true",
        help="Output all recursive fields separated by commas (e.g. for plotting)",
    )
    parser.add_argument(
        "-f",
        "--full-length",
        action="store_true",
        help="Output all elements for arrays, bytes, and string with a length > '--truncate-length', by "
        "default they are truncated after '--truncate-length' elements with '...'",
    )
    parser.add_argument(
        "-l",
        "--truncate-length",
        type=unsigned_int,
        metavar="N",
        help=f"The length to truncate arrays, bytes, and string to (default: {TRUNCATE_LENGTH}; JSON: all)",
    )
    parser.add_argument("--no-arr", action="store_true", help="Don't print array fields of messages")
    parser.add_argument("--no-str", action="store_true", help="Don't print string fields of messages")
    parser.add_argument("--flow-style", action="store_true", help="Print collections in the flow style")


def view_of(args: Namespace) -> View:
    """The view of the options. It has a budget if the output is YAML with truncated arrays."""
    length = args.truncate_length
    if length is None and not args.json:
        length = TRUNCATE_LENGTH
    is_cut_text = not (args.full_length or args.json or args.csv)
    return View(
        truncate_length=None if args.full_length else length,
        no_arr=args.no_arr,
        no_str=args.no_str,
        octets=args.json,
        budget=Budget(MOST_VALUES) if is_cut_text else None,
    )
