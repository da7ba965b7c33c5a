"""Check of a busd.toml by busd itself: the errors and warnings that a start with it would give now."""

import subprocess
from pathlib import Path
from typing import NamedTuple

from bus.link.autostart import BUSD
from bus_cli.output import CommandError

__all__ = ["Opinion", "ask"]

_CHECK_S = 30.0
"""Under a load of 15 on two processors, a start of Python took more than five seconds."""


class Opinion(NamedTuple):
    """Result of a check: the `fault` if busd would not start, else its `doubts`."""

    fault: str
    doubts: list[str]


def ask(file: Path, path: Path) -> Opinion:
    """Let a busd for the socket `path` check `file`. Raises CommandError if the check can't run."""
    command = [*BUSD, "--check", "--socket", str(path), "--config", str(file)]
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_CHECK_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise CommandError(
            f"{file} could not be checked: busd --check gave no answer within {_CHECK_S:g} s"
        ) from None
    except OSError as error:
        raise CommandError(f"{file} could not be checked: {error}") from None
    said = [line.removeprefix("busd: ") for line in done.stderr.decode(errors="replace").splitlines()]
    if done.returncode:
        return Opinion(said[-1] if said else f"{file} has an error", [])
    return Opinion("", said)
