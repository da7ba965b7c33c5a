"""`bus doctor --conformance`: plays the stories, prints each outcome, and sums them up."""

import os
import tempfile
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from bus.logger import Severity, get_logger
from bus_cli.doctor.conformance.conversation import LeftOut, Wrong
from bus_cli.doctor.conformance.stories import PROTOCOL, STORIES
from bus_cli.exitcodes import EXIT_ERROR
from bus_cli.output import CommandError, print_json, say
from bus_cli.stream import run_stream

__all__ = ["Outcome", "main", "outcome"]

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
        found = await outcome(name, command, args.wait)
        if found.mark == "fail":
            wrong.append(name)
        left_out += found.mark == "-"
        _print(args, name, found)
    return wrong, len(chosen) - left_out


class Outcome(NamedTuple):
    """The outcome of a story."""

    mark: str
    text: str
    output: str = ""
    """Of a wrong client."""
    place: str = ""
    """The page and the section to read about the mistake."""


async def outcome(name: str, command: Sequence[str], wait_s: float) -> Outcome:
    """Play one story."""
    story = STORIES[name]
    with tempfile.TemporaryDirectory(prefix="busd-") as folder:
        stage = story.stage(command, Path(folder), wait_s)
        try:
            async with stage:
                return Outcome("ok", await story.play(stage))
        except LeftOut as reason:
            return Outcome("-", f"left out: {reason}")
        except Wrong as mistake:
            place = (
                f'{PROTOCOL}, "{mistake.section}"' if mistake.section else f'{story.page}, "{story.section}"'
            )
            return Outcome("fail", str(mistake), stage.client.output, place)
        except (FileNotFoundError, PermissionError) as error:
            raise CommandError(f"{command[0]} can't be started: {error.strerror}") from None


def _print(args: Namespace, name: str, found: Outcome) -> None:
    lines = [line for line in found.output.splitlines() if line.strip()][-_LINES:]
    if args.json:
        print_json({"story": name, "mark": found.mark, "text": found.text, "output": lines})
        return
    say(f"[{found.mark:^4}] {name}: {found.text}")
    if found.mark == "fail":
        for line in lines:
            say(f"       | {line}")
        say(f"       -> {found.place}")
