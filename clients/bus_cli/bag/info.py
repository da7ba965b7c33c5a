"""`bus bag info`: a summary of a bag, and pictures of its losses."""

import os
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bus_cli.bag.reading import add_bag_argument, opened
from bus_cli.output import CommandError, print_json, say

if TYPE_CHECKING:
    from bus_bag.losses import TopicLosses
    from bus_bag.storage import BagReader
    from bus_plot.strips import Strip

_CELLS = 80
"""Width of the bars if the output is not a terminal."""


def add_arguments(parser: ArgumentParser) -> None:
    add_bag_argument(parser)
    parser.add_argument("-t", "--topic-name", action="store_true", help="Only display topic names.")
    parser.add_argument(
        "-v",
        "--verbose",
        action="store_true",
        help="Read all messages, for the size of each topic and the calls of services",
    )
    parser.add_argument(
        "--sort",
        default="name",
        choices=("name", "type", "count"),
        help="Sort topics by name, type or number of messages",
    )
    parser.add_argument(
        "--plot", action="store_true", help="Also show when messages were lost, as bars for each topic"
    )
    parser.add_argument(
        "--svg", metavar="FILE", type=Path, help="Write when messages were lost as a picture to FILE"
    )


def main(args: Namespace) -> int:
    from bus_bag.info import describe, find_losses, topic_names

    with opened(args) as reader:
        if args.svg is not None:
            _draw(reader, args.svg)
        if args.json:
            from msgspec import to_builtins
            from msgspec.structs import asdict

            from bus_bag.metadata import as_map

            record: dict[str, Any] = as_map(reader.metadata)
            problems = [{"path": one.path, "offset": one.offset, "text": one.text} for one in reader.problems]
            lost = {topic: to_builtins(asdict(one)) for topic, one in find_losses(reader).items()}
            print_json({**record, "losses": lost, "is_cut": reader.is_cut, "problems": problems})
        elif args.topic_name:
            for name in topic_names(reader.metadata, args.sort):
                say(name)
        else:
            say(describe(reader, verbose=args.verbose, sort=args.sort), end="")
            if args.plot:
                _plot(reader)
    return 0


def _plot(reader: "BagReader") -> None:
    """Print when messages were lost."""
    from bus_bag.info import find_losses, time_of_day
    from bus_plot.strips import strips_text

    if not (known := find_losses(reader)):
        say("\nNo record of losses: this bag is of another recorder.")
        return
    found = _strips(known)
    if not found:
        say("\nNothing was lost.")
        return
    begin_s, end_s = _span(reader)
    cells = os.get_terminal_size(sys.stdout.fileno()).columns - 1 if sys.stdout.isatty() else _CELLS
    say("\nLosses over time:")
    for line in strips_text(found, begin_s, end_s, cells, time_of_day):
        say(line)


def _draw(reader: "BagReader", path: Path) -> None:
    """Write the picture. Raises CommandError if there is nothing to draw, or the file can't be written."""
    from bus_bag.info import find_losses, time_of_day
    from bus_plot.strips import strips_svg

    found = _strips(find_losses(reader))
    begin_s, end_s = _span(reader)
    title = f"Lost messages of {reader.path.name}" if found else f"{reader.path.name}: nothing was lost"
    try:
        path.write_text(strips_svg(found, begin_s, end_s, title, time_of_day), encoding="utf-8")
    except OSError as error:
        raise CommandError(f"can't write {path}: {error.strerror}") from None


def _strips(known: "Mapping[str, TopicLosses]") -> "list[Strip]":
    """The losses of topics over time. Raises CommandError if the record is broken."""
    from bus_bag.info import strips

    try:
        return strips(known)
    except ValueError as error:
        raise CommandError(f"the record of losses is broken: {error}") from None


def _span(reader: "BagReader") -> tuple[float, float]:
    """The times of the first and the last message, in seconds."""
    metadata = reader.metadata
    return metadata.starting_time / 1e9, (metadata.starting_time + metadata.duration) / 1e9
