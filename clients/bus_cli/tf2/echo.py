"""`bus tf2 echo`: a transform between two frames, again and again; what `tf2_echo` of tf2_ros does."""

from argparse import ArgumentParser, Namespace

from bus_cli.completion import completed_by
from bus_cli.launch.bus import export
from bus_cli.tf2.heard import complete_frames


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(parser.add_argument("source_frame", help="the frame to print"), complete_frames)
    completed_by(
        parser.add_argument("target_frame", help="the frame that is looked for in it"), complete_frames
    )
    parser.add_argument("-r", "--rate", default="1", metavar="HZ", help="how often; once a second by default")
    parser.add_argument("-t", "--time", metavar="S", help="at this time; by default the latest")
    parser.add_argument("-p", "--precision", default="3", metavar="N", help="digits after the point; 3")


def main(args: Namespace) -> int:
    export(args)
    from bus_tf2.programs.tf2_echo import run

    time = [] if args.time is None else ["-t", args.time]
    return run([args.source_frame, args.target_frame, "-r", args.rate, "-p", args.precision, *time])
