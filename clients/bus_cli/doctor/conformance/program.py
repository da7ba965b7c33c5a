"""`bus doctor --conformance`: plays the stories, prints each outcome, and sums them up."""

import os
import tempfile
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

from bus.logger import Severity, get_logger
from bus_cli.doctor.conformance.conversation import LeftOut, Wrong
from bus_cli.doctor.conformance.stories import STORIES
from bus_cli.exitcodes import EXIT_ERROR
from bus_cli.output import CommandError, print_json, say
from bus_cli.stream import run_stream

__all__ = ["main", "outcome"]

_LINES = 5
"""Lines of the client's output that are shown with a mistake."""


def main(args: Namespace) -> int:
    command: Sequence[str] = args.program
    if not command:
        raise CommandError("which client? bus doctor --conformance -- ./client ARGS")
    if not args.wait > 0:
        raise CommandError(f"--wait is above 0, not {args.wait:g}")
    os.environ["BUSD_AUTOSTART"] = "0"  # while the busd of a story is away, no program starts one
    get_logger("bus").set_level(Severity.ERROR)  # its loss is a part of the story
    wrong, count = run_stream(_play(args, command))
    if not args.json:
        played = "1 story" if count == 1 else f"{count} stories"
        say(f"\n{len(wrong)} of {played} failed: {', '.join(wrong)}" if wrong else f"\n{played} passed")
    return EXIT_ERROR if wrong else 0


async def _play(args: Namespace, command: Sequence[str]) -> tuple[list[str], int]:
    """Play the chosen stories; returns the failed ones, and the number of played ones."""
    chosen = [name for name in STORIES if not args.story or name in args.story]
    wrong, left_out = [], 0
    for name in chosen:
        mark, text, output = await outcome(name, command, args.wait)
        if mark == "fail":
            wrong.append(name)
        left_out += mark == "-"
        _print(args, name, mark, text, output)
    return wrong, len(chosen) - left_out


async def outcome(name: str, command: Sequence[str], wait_s: float) -> tuple[str, str, str]:
    """Play one story: mark, text, and the output of a wrong client."""
    with tempfile.TemporaryDirectory(prefix="busd-") as folder:
        stage = STORIES[name].stage(command, Path(folder), wait_s)
        try:
            async with stage:
                return "ok", await STORIES[name].play(stage), ""
        except LeftOut as reason:
            return "-", f"left out: {reason}", ""
        except Wrong as mistake:
            return "fail", str(mistake), stage.client.output
        except (FileNotFoundError, PermissionError) as error:
            raise CommandError(f"{command[0]} can't be started: {error.strerror}") from None


def _print(args: Namespace, name: str, mark: str, text: str, output: str) -> None:
    lines = [line for line in output.splitlines() if line.strip()][-_LINES:]
    if args.json:
        print_json({"story": name, "mark": mark, "text": text, "output": lines})
        return
    say(f"[{mark:^4}] {name}: {text}")
    if mark == "fail":
        for line in lines:
            say(f"       | {line}")
        say(f'       -> {STORIES[name].page}, "{STORIES[name].section}"')
