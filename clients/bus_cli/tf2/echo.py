"""`bus tf2 echo`: print a transform between two frames repeatedly, as `tf2_echo` of tf2_ros does."""

from argparse import ArgumentParser, Namespace

from bus_cli.completion import completed_by
from bus_cli.launch.bus import export
from bus_cli.tf2.ends import by_signal
from bus_cli.tf2.heard import complete_frames


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("source_frame", help="frame in which the other is given"), complete_frames
    )
    completed_by(parser.add_argument("target_frame", help="frame to locate in the other"), complete_frames)
    parser.add_argument("-r", "--rate", default="1", metavar="HZ", help="lines per second (default: 1)")
    parser.add_argument("-t", "--time", metavar="S", help="time of the transform (default: the latest)")
    parser.add_argument(
        "-p", "--precision", default="3", metavar="N", help="digits after the point (default: 3)"
    )


def main(args: Namespace) -> int:
    export(args)
    from bus_tf2.programs.tf2_echo import run

    time = [] if args.time is None else ["-t", args.time]
    words = [args.source_frame, args.target_frame, "-r", args.rate, "-p", args.precision, *time]
    return by_signal(run(words))
