"""`bus bag burst`: publish messages of a bag at once, then pause."""

from argparse import ArgumentParser, Namespace

from bus_cli.bag.playargs import add_reader_arguments, play
from bus_cli.stream import unsigned_int


def add_arguments(parser: ArgumentParser) -> None:
    add_reader_arguments(parser)
    parser.add_argument(
        "-n",
        "--num-messages",
        metavar="N",
        type=unsigned_int,
        default=0,
        help="Number of messages to play at once, before the pause (default: all)",
    )


def main(args: Namespace) -> int:
    return play(args, burst=args.num_messages, is_paused=True)
