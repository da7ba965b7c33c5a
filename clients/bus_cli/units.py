"""Files of systemd units: their folder, their words, and how they are written and removed.

The first line of each file says which command wrote it. Files without that line are never changed.
"""

import os
from pathlib import Path

from bus_cli.output import CommandError

__all__ = ["quoted", "remove", "systemctl", "unit_folder", "write"]


def unit_folder(*, is_system: bool) -> Path:
    """The folder of the machine's units, or of the user's own ones."""
    if is_system:
        return Path("/etc/systemd/system")
    return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "systemd" / "user"


def systemctl(*, is_system: bool) -> str:
    """The command for these units."""
    return "systemctl" if is_system else "systemctl --user"


def quoted(word: str) -> str:
    """Quote a word by the rules of systemd.service(5)."""
    for plain, said in (("\\", "\\\\"), ('"', '\\"'), ("%", "%%"), ("$", "$$"), ("\n", "\\n"), ("\r", "\\r")):
        word = word.replace(plain, said)
    return f'"{word}"' if any(c in word for c in " \t'\"\\;") else word


def write(path: Path, text: str) -> None:
    """Write a unit. Raises CommandError if another program has written the present file, or if it can't."""
    mark = text.partition("\n")[0]
    try:
        if path.exists() and not path.read_text(errors="replace").startswith(mark):
            command = mark.removeprefix("# Written by ").removesuffix(".")
            raise CommandError(f"{path} was not written by {command}; move it away first")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(os.fsencode(text))  # paths in it need not be UTF-8
    except OSError as error:
        raise CommandError(f"can't write {path}: {error.strerror}") from None


def remove(path: Path, mark: str, target: str) -> bool:
    """Remove a unit that begins with `mark`, and its link in `target`; returns whether it was there.

    Raises CommandError if it can't.
    """
    try:
        if not path.read_text(errors="replace").startswith(mark):
            return False
        path.unlink()
    except FileNotFoundError:
        return False
    except OSError as error:
        raise CommandError(f"can't remove {path}: {error.strerror}") from None
    wanted = path.parent / f"{target}.wants" / path.name
    if wanted.is_symlink():
        wanted.unlink()  # else systemd looks for the missing unit at each start
    return True
