"""`bus bag burst`: publish messages of a bag at once, then pause."""

from argparse import ArgumentParser, Namespace

from bus_cli.bag.playargs import add_reader_arguments, not_negative_int, play


def add_arguments(parser: ArgumentParser) -> None:
    add_reader_arguments(parser)
    parser.add_argument(
        "-n",
        "--num-messages",
        metavar="N",
        type=not_negative_int,
        default=0,
        help="How many messages come at once, before the pause (default: all)",
    )


def main(args: Namespace) -> int:
    return play(args, burst=args.num_messages, is_paused=True)
