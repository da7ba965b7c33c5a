"""The daemon's configuration file, as it is now: busd itself looks at it, as before a restart."""

import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from bus.cli.doctor import procfs
from bus.cli.doctor.finding import Finding, fail, ok, warn

__all__ = ["examine", "file_of"]

_CHECK_S = 5.0


def examine(path: Path, pid: int) -> Iterator[Finding]:
    """Of the daemon `pid`, which listens at `path`. Nothing where it has no file, or we may not look."""
    file = file_of(procfs.command_line(pid), procfs.folder(pid))
    if file is None:
        return
    command = [sys.executable, "-m", "busd", "--check", "--socket", str(path), "--config", str(file)]
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_CHECK_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        yield warn("configuration", f"{file} could not be looked at: {error}")
        return
    said = [line.removeprefix("busd: ") for line in done.stderr.decode(errors="replace").splitlines()]
    if done.returncode:
        advice = "mend it: the daemon goes on with what it has, but can't be restarted"
        yield fail("configuration", said[-1] if said else f"{file} is not right", advice)
    elif said:
        yield from (warn("configuration", doubt, f"edit {file}, then bus daemon reload") for doubt in said)
    else:
        yield ok("configuration", str(file))


def file_of(words: Sequence[str], folder: Path | None) -> Path | None:
    """The file that a busd with this command line was given; `folder` is the one it was started in."""
    for at, word in enumerate(words):
        name, equals, value = word.partition("=")
        if name == "--config":
            value = value if equals else next(iter(words[at + 1 :]), "")
            found = Path(value)
            if not found.is_absolute():
                return folder / found if folder is not None and value else None
            return found
    return None
