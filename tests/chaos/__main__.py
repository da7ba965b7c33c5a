"""`python -m chaos --seconds 60 --seed 7`: storms over a separate bus, and their results."""

import argparse
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

from chaos import cgroup
from chaos.deeds import LEASE_S
from chaos.director import Broker, Director, Failed
from chaos.plan import Plan
from chaos.report import Tally
from chaos.stage import Stage
from chaos.stories import CGROUP, STORIES


def main() -> int:
    parser = argparse.ArgumentParser(prog="chaos", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60, help="how long (default 60)")
    parser.add_argument("--seed", type=int, default=0, help="repeats the faults of a run (default: another)")
    parser.add_argument("--folder", type=Path, help="where logs are left (default: a temporary folder)")
    parser.add_argument(
        "--without",
        action="append",
        choices=STORIES,
        default=[],
        help="leave out this story (can be repeated)",
    )
    args = parser.parse_args()
    seed = args.seed or time.time_ns() % 1_000_000_000
    print(f"chaos for {args.seconds:g} s, seed {seed}", flush=True)
    stories = set(STORIES).difference(args.without)
    if CGROUP in stories and (reason := cgroup.why_not()):
        print(f"nobody in a memory cgroup: {reason}", flush=True)
        stories.discard(CGROUP)
    folder = args.folder or Path(tempfile.mkdtemp(prefix="chaos-"))
    tally = Tally(seed)
    try:
        _run(folder, args.seconds, frozenset(stories), tally)
    except Failed as failure:
        _explain(folder, tally, failure)
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        status = 130
    else:
        print("\n".join(tally.lines()))
        status = 0
    if args.folder is None:
        shutil.rmtree(folder)
    return status


def _run(folder: Path, time_s: float, stories: frozenset[str], tally: Tally) -> None:
    place = folder / "socket"  # not bus: its processes run in the folder, and would import that
    place.mkdir(parents=True, exist_ok=True)
    path = place / "busd.sock"
    environment = {key: value for key, value in os.environ.items() if key != "BUS_ROUTE"}
    environment |= {
        "BUSD_SOCKET": str(path),
        "BUSD_AUTOSTART": "0",
        "PYTHONPATH": os.pathsep.join(map(str, (Path(__file__).parents[1], *sys.path))),
    }
    config = folder / "busd.toml"
    config.write_text(f"[limits]\nlease_s = {LEASE_S}\n")
    shared = set(os.listdir("/dev/shm"))  # noqa: PTH208
    daemon = Broker(path, "--config", str(config))
    try:
        with Stage(folder, environment) as stage:
            director = Director(Plan(tally.seed, stories), stage, daemon, tally)
            director.run(time_s)
            director.end()
    finally:
        if daemon.process.poll() is None:
            daemon.kill()
    left = [str(one) for one in place.iterdir() if one != daemon.log]
    left += [f"/dev/shm/{name}" for name in set(os.listdir("/dev/shm")) - shared if "bus" in name]  # noqa: PTH208
    if left:
        raise Failed("no file is left", left)


def _explain(folder: Path, tally: Tally, failure: Failed) -> None:
    print(f"FAILED: {failure.invariant} (seed {tally.seed}, logs in {folder})")
    for complaint in failure.complaints[:20]:
        print(f"  {complaint}")
    named = {log.stem for log in folder.glob("*.log") if any(log.stem in one for one in failure.complaints)}
    for name in sorted(named)[:4]:
        print(f"{name}'s last lines:")
        for line in Path(folder / f"{name}.log").read_text(errors="replace").splitlines()[-12:]:
            print(f"  {line[:300]}")
    print("\n".join(tally.lines()))


if __name__ == "__main__":
    sys.exit(main())
