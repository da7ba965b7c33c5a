"""`bus tf2 frames`: draw the tree of frames, as `view_frames` of tf2_tools does."""

from argparse import ArgumentParser, Namespace

from bus_cli.launch.bus import export
from bus_cli.tf2.ends import by_signal


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "-t", "--wait-time", type=float, default=5.0, metavar="S", help="seconds to listen (default: 5)"
    )
    parser.add_argument("-o", "--output", metavar="NAME", help="write NAME.gv and NAME.pdf")


def main(args: Namespace) -> int:
    export(args)
    from bus_tf2.programs.view_frames import run

    output = [] if args.output is None else ["-o", args.output]
    return by_signal(run(["-t", str(args.wait_time), *output]))
