"""What the programs of chaos with bridges share: their options, their buses, and their end."""

import argparse
import asyncio
import os
import random
import sys
import tempfile
import time
from collections.abc import Callable, Coroutine
from io import TextIOWrapper
from pathlib import Path
from typing import Any

from bridged_world import World
from bus.runner import loop_factory

__all__ = ["Broken", "play"]

Storm = Callable[[World, int, random.Random], Coroutine[Any, Any, None]]


class Broken(Exception):
    """An invariant was violated."""


def play(name: str, about: str | None, kills: int, why_not: str, buses: tuple[str, ...], storm: Storm) -> int:
    """Run a program of that name: parse its options, and make a storm between `buses`. Returns its status.

    `kills`: how many faults by default. `why_not`: why it can't run here.
    """
    parser = argparse.ArgumentParser(prog=name, description=about)
    parser.add_argument("--kills", type=int, default=kills, help=f"how many faults (default {kills})")
    parser.add_argument("--seed", type=int, default=0, help="repeats the faults of a run (default: another)")
    args = parser.parse_args()
    seed = args.seed or time.time_ns() % 1_000_000_000
    if why_not:
        print(f"{name} is left out: {why_not}")
        return 0
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)  # each round is shown as it begins, in a pipe too
    print(f"{name}: {args.kills} faults, seed {seed}")
    os.environ["BUSD_AUTOSTART"] = "0"
    with tempfile.TemporaryDirectory(prefix="chaos-") as folder:
        try:
            with (
                World(Path(folder), None, *buses) as world,
                asyncio.Runner(loop_factory=loop_factory()) as runner,
            ):
                runner.run(storm(world, args.kills, random.Random(seed)))
        except Broken as broken:
            print(f"FAILED: {broken} (seed {seed})")
            return 1
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            return 130
    return 0
