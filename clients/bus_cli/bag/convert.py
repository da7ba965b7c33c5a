"""`bus bag convert`: rewrite bags with other options."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from bus_cli.output import CommandError, complain, say


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "-i",
        "--input",
        required=True,
        action="append",
        nargs="+",
        metavar=("uri", "storage_id"),
        help="URI (and optional storage ID) of an input bag. May be provided more than once",
    )
    parser.add_argument(
        "-o",
        "--output-options",
        required=True,
        type=Path,
        metavar="FILE",
        help="YAML file with options for output bags: a list 'output_bags' of maps with 'uri' and more",
    )


def main(args: Namespace) -> int:
    from bus_bag.convert import convert, read_outputs
    from bus_bag.errors import BagError
    from bus_bag.terminal.status_line import StatusLine

    inputs = [_input(words) for words in args.input]
    try:
        outputs = read_outputs(args.output_options.read_text(errors="replace"))
    except BagError as error:
        raise CommandError(f"'{args.output_options}': {error}") from None
    line = StatusLine()

    def progress(done: int, total: int) -> None:
        line.show(f"{done} of {total} messages")

    try:
        warnings = convert(inputs, outputs, progress)
    finally:
        line.close()
    for warning in warnings:
        complain(f"[WARN] [ros2bag]: {warning}")
    for output in outputs:
        say(output.uri)
    return 0


def _input(words: list[str]) -> Path:
    """Path of an input bag. Errors have ROS 2's texts."""
    from bus_bag.storage.registry import storages

    if len(words) > 2:
        raise CommandError(f"--input expects 1 or 2 arguments, {len(words)} provided")
    path = Path(words[0])
    if not path.exists():
        raise CommandError(f"Bag path '{path}' does not exist!")
    known = [one.identifier for one in storages()]
    if len(words) == 2 and words[1] not in known:
        raise CommandError(f"Unknown storage ID '{words[1]}', options are: {', '.join(known)}")
    return path
