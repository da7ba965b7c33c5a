"""The daemon's configuration file, as it is now: busd itself looks at it, as before a restart."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from bus_cli.configuration import ask
from bus_cli.doctor import procfs
from bus_cli.doctor.finding import Finding, fail, ok, warn
from bus_cli.output import CommandError

__all__ = ["examine", "file_of", "file_of_daemon"]


def examine(path: Path, pid: int) -> Iterator[Finding]:
    """Of the daemon `pid`, which listens at `path`. Nothing where it has no file, or we may not look."""
    file = file_of_daemon(pid)
    if file is None:
        return
    try:
        opinion = ask(file, path)
    except CommandError as error:
        yield warn("configuration", str(error))
        return
    if opinion.fault:
        advice = "correct it: the daemon keeps its configuration, but can't restart with this file"
        yield fail("configuration", opinion.fault, advice)
    for doubt in opinion.doubts:
        yield warn("configuration", doubt, f"edit {file}, then bus daemon reload")
    if not opinion.fault and not opinion.doubts:
        yield ok("configuration", str(file))


def file_of_daemon(pid: int) -> Path | None:
    """The file that the busd with this process id was given; None where there is none, or we may not look."""
    return file_of(procfs.command_line(pid), procfs.folder(pid))


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
