"""`bus bag convert`: rewrite bags with other options."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from bus_cli.bag.reading import add_input_argument, input_paths
from bus_cli.output import CommandError, complain, say


def add_arguments(parser: ArgumentParser) -> None:
    add_input_argument(parser, is_required=True)
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

    inputs = input_paths(args)
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
