"""A busd.toml, as busd itself sees it: what it would say if it were started with it now."""

import subprocess
from pathlib import Path
from typing import NamedTuple

from bus.link.autostart import BUSD
from bus_cli.output import CommandError

__all__ = ["Opinion", "ask"]

_CHECK_S = 30.0
"""A start of Python beside a load of 15 on two processors took more than five."""


class Opinion(NamedTuple):
    """`doubts` where it would start, else the `fault`."""

    fault: str
    doubts: list[str]


def ask(file: Path, path: Path) -> Opinion:
    """Have a busd for the socket `path` look at `file`. Raises CommandError where none can be asked."""
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
