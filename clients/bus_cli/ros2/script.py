"""The file `ros2`: its text, its folder, and other files of this name."""

import os
import shlex
import sys
import sysconfig
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path

from bus_cli.output import CommandError
from bus_cli.program_name import ALIAS, NAME

__all__ = ["MARK", "add_folder_argument", "folder_of", "foreign", "is_ours", "programs", "script_text"]

MARK = "# This ros2 belongs to busd: it runs the program bus."
"""Line in each file `ros2` of busd."""

_HEAD_BYTES = 1024
_LONGEST_FIRST_LINE = 127  # bytes of a `#!` line that older kernels read

_BODY = """\
{mark}
# To remove it, type: bus ros2 uninstall
import sys

try:
    from bus_cli.entry import main
except ModuleNotFoundError as error:
    if error.name != "bus_cli":
        raise
    sys.exit(f"ros2: busd is not installed in {{sys.prefix}} any more; remove this file: {{__file__}}")
sys.exit(main())
"""


def add_folder_argument(parser: ArgumentParser) -> None:
    parser.add_argument("--into", metavar="FOLDER", help="the folder of ros2 (default: the folder of bus)")


def folder_of(args: Namespace) -> Path:
    """The folder for `ros2`; one of --into may be missing. Raises CommandError if there is none."""
    if args.into is not None:
        folder = Path(os.path.abspath(args.into))  # noqa: PTH100 (a link stays a link)
        if folder.exists() and not folder.is_dir():
            raise CommandError(f"{args.into} is not a folder")
        return folder
    for folder in _folders():
        if (folder / NAME).is_file():
            return folder
    raise CommandError(f"can't find the program bus of {sys.executable}; choose a folder with --into FOLDER")


def script_text(python: str) -> str:
    """The text of the file, for a path of Python."""
    first = f"#!{python}\n"
    if " " in python or len(first.encode()) > _LONGEST_FIRST_LINE:
        # Both a shell and Python can read these lines. For Python they are a text.
        first = f"#!/bin/sh\n'''exec' {shlex.quote(python)} \"$0\" \"$@\"\n' '''\n"
    return first + _BODY.format(mark=MARK)


def is_ours(path: Path) -> bool:
    """Whether busd has written a file; False if it can't be read."""
    try:
        with path.open("rb") as file:
            return MARK.encode() in file.read(_HEAD_BYTES)
    except OSError:
        return False


def foreign(folder: Path, path: Sequence[str]) -> Path | None:
    """A `ros2` of another origin: any in `folder`, or a program in a folder of `path`."""
    here = folder / ALIAS
    if (here.is_symlink() or here.exists()) and not is_ours(here):
        return here
    return next((found for found in programs(path) if not is_ours(found)), None)


def programs(path: Sequence[str]) -> Iterator[Path]:
    """The programs `ros2` in the folders of `path`, in their order."""
    for one in path:
        found = Path(one or os.curdir) / ALIAS
        if found.is_file() and os.access(found, os.X_OK):
            yield found


def _folders() -> Iterator[Path]:
    """Possible folders of the program `bus`, the likeliest one first."""
    started = sys.argv[0] if sys.argv else ""
    if os.path.basename(started) in (NAME, ALIAS):  # noqa: PTH119
        yield Path(os.path.abspath(started)).parent  # noqa: PTH100 (a link stays a link)
    for scheme in (sysconfig.get_default_scheme(), sysconfig.get_preferred_scheme("user")):
        yield Path(sysconfig.get_path("scripts", scheme))
