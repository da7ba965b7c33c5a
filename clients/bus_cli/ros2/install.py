"""`bus ros2 install`: write an executable file `ros2` that runs `bus`."""

import os
import shutil
import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

from bus_cli.output import CommandError, complain, print_json, say
from bus_cli.program_name import ALIAS
from bus_cli.ros2.script import add_folder_argument, folder_of, foreign, script_text


def add_arguments(parser: ArgumentParser) -> None:
    parser.description = (
        "Write an executable file `ros2` beside `bus`, so that scripts, Makefiles and Python's subprocess "
        "find busd's program under that name. If a `ros2` of another origin is in PATH or in the folder, the "
        "verb writes nothing."
    )
    add_folder_argument(parser)


def main(args: Namespace) -> int:
    folder = folder_of(args)
    path = os.environ.get("PATH", os.defpath).split(os.pathsep)
    if (other := foreign(folder, path)) is not None:
        raise CommandError(f"{other} is not from busd; nothing was written, because one would hide the other")
    target, text = folder / ALIAS, script_text(sys.executable)
    is_new = not _has(target, text)
    if is_new:
        _write(target, text)
    if args.json:
        print_json({"file": str(target), "written": is_new})
        return 0
    say(f"Wrote {target}" if is_new else f"{target} is already there")
    found = shutil.which(ALIAS)
    if found is None:
        complain(f"the shell does not find it yet: {folder} is not in PATH")
    elif Path(found).absolute() != target:
        complain(f"the shell finds another one of busd first: {found}")
    return 0


def _has(target: Path, text: str) -> bool:
    try:
        return target.read_text() == text and os.access(target, os.X_OK)
    except (OSError, UnicodeDecodeError):
        return False


def _write(target: Path, text: str) -> None:
    """Replace the file in one step: a program that starts meanwhile sees the old or the new one."""
    new = target.with_name(f".{ALIAS}.{os.getpid()}")
    try:
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            new.write_text(text)
            new.chmod(0o755)
            new.replace(target)
        finally:
            if target.parent.is_dir():
                new.unlink(missing_ok=True)
    except OSError as error:
        raise CommandError(f"can't write {target}: {error.strerror}") from None
