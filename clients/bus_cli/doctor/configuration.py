"""The daemon's current configuration file. busd itself checks it, as before a restart."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from bus_cli.configuration import ask
from bus_cli.doctor import procfs
from bus_cli.doctor.finding import Finding, fail, ok, warn
from bus_cli.output import CommandError

__all__ = ["examine", "file_of", "file_of_daemon"]


def examine(path: Path, pid: int) -> Iterator[Finding]:
    """Findings about the file of the daemon `pid`, which listens at `path`.

    There are none if it has no file, or if /proc hides its command line from us.
    """
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
    """The configuration file of the busd `pid`; None without one, or if /proc hides it from us."""
    return file_of(procfs.command_line(pid), procfs.folder(pid))


def file_of(words: Sequence[str], folder: Path | None) -> Path | None:
    """The configuration file in the command line `words` of a busd that was started in `folder`."""
    for at, word in enumerate(words):
        name, equals, value = word.partition("=")
        if name == "--config":
            value = value if equals else next(iter(words[at + 1 :]), "")
            found = Path(value)
            if not found.is_absolute():
                return folder / found if folder is not None and value else None
            return found
    return None
