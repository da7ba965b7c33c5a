"""`bus ros2 uninstall`: remove the file `ros2` that `bus ros2 install` wrote."""

from argparse import ArgumentParser, Namespace

from bus_cli.output import CommandError, print_json, say
from bus_cli.program_name import ALIAS
from bus_cli.ros2.script import add_folder_argument, folder_of, is_ours


def add_arguments(parser: ArgumentParser) -> None:
    parser.description = "Remove the file `ros2` that `bus ros2 install` wrote. Others stay."
    add_folder_argument(parser)


def main(args: Namespace) -> int:
    target = folder_of(args) / ALIAS
    is_there = target.is_symlink() or target.exists()
    if is_there and not is_ours(target):
        raise CommandError(f"{target} is not from busd; it was not removed")
    if is_there:
        try:
            target.unlink()
        except OSError as error:
            raise CommandError(f"can't remove {target}: {error.strerror}") from None
    if args.json:
        print_json({"file": str(target), "removed": is_there})
    else:
        say(f"Removed {target}" if is_there else f"{target} is not there")
    return 0
