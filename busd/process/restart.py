"""Restarts busd: the same process runs the program again, and keeps its listening socket.

Owns the command line of the next busd, the check whether that can start, and the exec. Must not know what the
daemon serves, nor how it ends. So a restart runs the release installed now, no client's connect fails
meanwhile, and no other busd gets in between.
"""

import asyncio
import os
import sys
from collections.abc import Mapping, Sequence

__all__ = ["CHECK", "command_line", "find_fault", "hand_over"]

CHECK = "--check"
"""The option with which busd only checks whether it could start."""

_CHECK_S = 20.0


def command_line(arguments: Sequence[str] | None) -> list[str]:
    """The command line for the same busd again. `arguments` are busd's own; None: the arguments of this
    process.
    """
    if arguments is None:
        return [sys.executable, *sys.orig_argv[1:]]
    return [sys.executable, "-m", "busd", *arguments]


async def find_fault(command: Sequence[str]) -> str:
    """Why `command` could not start, in one line; empty if it could."""
    try:
        process = await asyncio.create_subprocess_exec(
            *command,
            CHECK,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
        )
    except OSError as error:
        return f"{command[0]}: {error.strerror}"
    try:
        async with asyncio.timeout(_CHECK_S):
            _, said = await process.communicate()
    except TimeoutError:
        process.kill()
        await process.wait()
        return f"the new busd does not come up within {_CHECK_S:g} s"
    if not process.returncode:
        return ""
    lines = said.decode(errors="replace").strip().splitlines()
    return lines[-1].removeprefix("busd: ") if lines else f"the new busd ended with {process.returncode}"


def hand_over(command: Sequence[str], bequest: Mapping[str, str]) -> None:
    """Become `command`; its environment has the `bequest`, too. Returns only by raising OSError."""
    os.execve(command[0], [*command], {**os.environ, **bequest})
