"""`bus tf2 monitor`: print delays and rates of transforms, as `tf2_monitor` of tf2_ros does."""

from argparse import ArgumentParser, Namespace

from bus_cli.completion import completed_by
from bus_cli.launch.bus import export
from bus_cli.tf2.ends import by_signal
from bus_cli.tf2.heard import complete_frames


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument(
            "frames", nargs="*", metavar="FRAME", help="show the transform between these two frames"
        ),
        complete_frames,
    )


def main(args: Namespace) -> int:
    export(args)
    from bus_tf2.programs.tf2_monitor import run

    return by_signal(run(args.frames))
