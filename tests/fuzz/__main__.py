"""`python -m fuzz`: runs the fuzzers, as many at a time as there are processors, and prints the results.

Inputs that a run finds interesting stay in .fuzz/, and the next run continues with them. --merge brings them
into the corpus, with few inputs for the same coverage. An input that makes a target fail is added to
crashes/<target>.txt.
"""

import argparse
import hashlib
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from fuzz.cover import covering
from fuzz.kept import CORPUS, CRASHES, inputs, keep
from fuzz.targets import NATIVE, OF_THE_CORE, TARGETS

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "tests" / "native" / "build" / "fuzz"
FOUND = ROOT / ".fuzz"
PROGRAMS = {
    "ring": "fuzz_ring",
    "gates": "fuzz_gates",
    "records": "fuzz_records",
    "c_client": "fuzz_client",
    **dict.fromkeys(OF_THE_CORE, "fuzz_core"),
}
"""Fuzzers for targets with code in C; only there the fuzzer sees the coverage."""

LONGEST_BYTES = {
    "broker": 400,
    "client": 400,
    "reader": 400,
    "discovery_servers": 400,
    "control": 2000,
    "c_client": 2000,
    "ring": 512,
    "gates": 512,
}
USUAL_LONGEST_BYTES = 1024
TIMEOUT_S = 20
"""For one input: above this, it hangs."""
MEMORY_MIB = 1024
START_S = 300
"""For a fuzzer's start, in which it runs all kept inputs, and for its end; in addition to its share."""

_PROGRESS = re.compile(
    r"^#(\d+)\s+(?:DONE|pulse|NEW|REDUCE|INITED).*?cov: (\d+) ft: (\d+) corp: (\d+)/(\S+)", re.MULTILINE
)


class Outcome(NamedTuple):
    """The results of one fuzzer; `log` is its whole output."""

    runs: int
    coverage: int
    features: int
    corpus: str
    crashes: list[Path]
    has_failed: bool
    log: str


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="fuzz", description="Run the fuzzers on everything that takes input."
    )
    parser.add_argument("targets", nargs="*", help=f"only these, of: {', '.join((*TARGETS, *NATIVE))}")
    parser.add_argument("--seconds", type=float, default=60, help="for all of them together (default: 60)")
    parser.add_argument("--merge", action="store_true", help="bring what was found into the corpus instead")
    args = parser.parse_args()
    wanted = args.targets or [*TARGETS, *NATIVE]
    if strange := [name for name in wanted if name not in (*TARGETS, *NATIVE)]:
        parser.error(f"no such target: {', '.join(strange)}")
    if args.merge:
        return max(map(_merge, wanted))
    ready = _ready(wanted)
    if not ready:
        print("nothing could be run: it takes atheris (pip install -e '.[fuzz]') or clang with libFuzzer")
        return 1
    return _fuzz(ready, args.seconds)


def _ready(wanted: list[str]) -> list[str]:
    """The targets that can run here; prints the reason for the others."""
    command = [
        "make",
        "-sk",
        "-C",
        str(ROOT / "tests" / "native"),
        "fuzzers",
        f"PYTHON={sys.executable}",
    ]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    if made.returncode:
        print(f"not every fuzzer in C could be built (clang with libFuzzer?): {made.stderr.strip()[:200]}")
    has_atheris = find_spec("atheris") is not None
    ready = [name for name in wanted if _program(name) or (has_atheris and name in TARGETS)]
    if out := [name for name in wanted if name not in ready]:
        why = "" if has_atheris else " (atheris is not there: pip install -e '.[fuzz]')"
        print(f"left out{why}: {', '.join(out)}")
    return ready


def _program(name: str) -> list[str]:
    """A target's fuzzer in C, if it has one and it is built."""
    path = BUILD / PROGRAMS.get(name, "none")
    return [str(path)] if path.exists() else []


def _fuzz(names: list[str], seconds: float) -> int:
    at_once = min(os.cpu_count() or 1, len(names))
    share_s = max(1, round(seconds * at_once / len(names)))
    print(f"{len(names)} targets, {at_once} at a time, {share_s} s each")
    print(f"{'target':<14} {'runs':>10} {'per s':>8} {'coverage':>9} {'features':>9} {'corpus':>12}  crashes")
    has_failed = False
    with ThreadPoolExecutor(at_once) as pool:
        running = [pool.submit(_run, name, share_s) for name in names]
        try:
            for name, future in zip(names, running, strict=True):
                _tell(name, future.result(), share_s)
                has_failed |= future.result().has_failed
        except KeyboardInterrupt:  # the fuzzers got it, too
            pool.shutdown(cancel_futures=True)
            return 130
    return int(has_failed)


def _tell(name: str, outcome: Outcome, share_s: int) -> None:
    print(
        f"{name:<14} {outcome.runs:>10} {outcome.runs // share_s:>8} {outcome.coverage:>9} "
        f"{outcome.features:>9} {outcome.corpus:>12}  {len(outcome.crashes)}",
        flush=True,
    )
    for path in outcome.crashes:
        print(f"  {path.relative_to(ROOT)} makes it fail")
    if outcome.has_failed:
        print("  " + "\n  ".join(outcome.log.splitlines()[-40:]))


def _run(name: str, share_s: int) -> Outcome:
    found, crashes = FOUND / name, FOUND / "crashes" / name
    for folder in (found, crashes):
        folder.mkdir(parents=True, exist_ok=True)
    before = set(crashes.iterdir())
    _unpack(inputs(CORPUS, name), found)
    options = (
        str(found),
        f"-max_total_time={share_s}",
        f"-max_len={_longest(name)}",
        "-len_control=0",
        f"-timeout={TIMEOUT_S}",
        f"-report_slow_units={TIMEOUT_S}",
        f"-rss_limit_mb={MEMORY_MIB}",
        f"-artifact_prefix={crashes}/",
        "-print_final_stats=1",
    )
    program = _program(name) or [sys.executable, "-m", "fuzz.worker", name]
    log, status = _call(name, program, options, limit_s=share_s + START_S)
    failing = sorted(set(crashes.iterdir()) - before)
    if failing:
        keep(CRASHES, name, [*inputs(CRASHES, name), *(path.read_bytes() for path in failing)])
    runs, coverage, features, corpus = 0, 0, 0, "-"
    for progress in _PROGRESS.finditer(log):
        runs, coverage, features = (int(progress[at]) for at in (1, 2, 3))
        corpus = f"{progress[4]}/{progress[5]}"
    return Outcome(runs, coverage, features, corpus, failing, bool(failing) or status != 0, log)


def _merge(name: str) -> int:
    """Write the corpus again: few inputs with the same coverage as the corpus and all found inputs."""
    _unpack(inputs(CORPUS, name), FOUND / name)
    if program := _program(name):
        with tempfile.TemporaryDirectory() as folder:
            options = ("-set_cover_merge=1", f"-max_len={_longest(name)}", folder, str(FOUND / name))
            log, status = _call(name, program, options, limit_s=600)
            if status:
                print(log)
                return status
            kept = [path.read_bytes() for path in Path(folder).iterdir()]
    else:
        found = [path.read_bytes() for path in (FOUND / name).iterdir()]
        kept = covering(name, [data for data in found if len(data) <= _longest(name)])
    keep(CORPUS, name, kept)
    print(f"{name}: {len(kept)} inputs, {sum(map(len, kept))} bytes", flush=True)
    return 0


def _unpack(data: Iterable[bytes], folder: Path) -> None:
    """Write inputs as files for a fuzzer, with the names that a fuzzer uses."""
    folder.mkdir(parents=True, exist_ok=True)
    for one in data:
        (folder / hashlib.sha1(one).hexdigest()).write_bytes(one)


def _longest(name: str) -> int:
    return LONGEST_BYTES.get(name, USUAL_LONGEST_BYTES)


def _call(name: str, program: list[str], options: Iterable[str], *, limit_s: float) -> tuple[str, int]:
    """Run a fuzzer with these options of libFuzzer; returns its log and its exit status."""
    ours = [str(ROOT / folder) for folder in ("tests", "tests/world", "clients", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((*ours, *sys.path)), "FUZZ_TARGET": name}
    try:
        done = subprocess.run(
            [*program, *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            env=environment,
            timeout=limit_s,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        return f"{error.stdout or ''!s}\n{name} did not end within {limit_s:g} s", 1
    return done.stdout, done.returncode


if __name__ == "__main__":
    sys.exit(main())
