"""`python -m wheels --into dist`: makes sdist and wheels and checks them. Exit status 1: one is wrong."""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import inherited_signals
import pythons
from wheels import Missing, Wrong, aarch64, building, contents, extras, first_use, version
from wheels.sources import ROOT

_Job = Callable[[], str]


def main() -> int:
    parser = argparse.ArgumentParser(prog="wheels", description=__doc__)
    parser.add_argument("--into", type=Path, default=ROOT / "dist", help="where they are put (default: dist)")
    into = parser.parse_args().into
    inherited_signals.restore()  # the programs that are tried must hear SIGINT, under a CI runner too
    with tempfile.TemporaryDirectory(prefix="wheels-") as name:
        try:
            packages, lacking = _make(Path(name))
        except Wrong as error:
            print(f"wheels: {error}", file=sys.stderr)
            return 1
        into.mkdir(exist_ok=True)
        for old in into.glob("busd-*"):
            old.unlink()
        for package in packages:
            shutil.copy(package, into)
            print(f"{package.stat().st_size / 1e3:8.0f} kB  {into / package.name}")
    for reason in lacking:
        print(reason)
    return 0


def _make(folder: Path) -> tuple[list[Path], list[str]]:
    """Build and check all below `folder`: the packages of a release, and the reason if a wheel is missing.

    The wheel without the core is tried, but it is no part of a release: pip would prefer it to the sdist on
    every platform that has no wheel of its own, even beside a compiler. The sdist decides on the machine.
    """
    sdist, tree = building.build_sdist(folder)
    contents.check_sdist(sdist, contents.files_of(tree))
    _say(f"{sdist.name}: has all of the tree")
    pure = building.build_wheel(sdist, folder / "pure", BUS_NATIVE="no")
    contents.check_wheel(pure, tree, with_core=False)
    # If the compiler fails, pip makes the same; what it prints of the compiler's fault is no fault here.
    failed = building.build_wheel(sdist, folder / "failed", may_warn=True, CC="false")
    contents.check_wheel(failed, tree, with_core=False)
    _say(f"{pure.name}: no core in it, and none if the compiler fails; not published")
    found = pythons.find()
    for name in pythons.missing(found):
        _say(f"Python {name}: not found")
    jobs = [partial(_use, python, pure, folder / "use", with_core=False) for python in found]
    wheels: list[Path] = []
    lacking: list[str] = []
    if shutil.which(building.compiler()):
        native = building.build_native(sdist, folder / "native", building.compiler())
        wheels.append(native)
        jobs += [partial(_use, python, native, folder / "use", with_core=True) for python in found]
        try:
            machine = aarch64.find_machine()
            wheel = aarch64.build(sdist, machine, folder / "aarch64")
        except Missing as error:
            lacking.append(f"no aarch64 wheel was made: {error}")
        else:
            wheels.append(wheel)
            jobs.append(partial(aarch64.try_wheel, wheel, native, found[0], machine, folder / "on_aarch64"))
    else:
        lacking.append(f"no wheel with the core was made: no {building.compiler()}")
    for wheel in wheels:
        contents.check_wheel(wheel, tree, with_core=True)
        _say(f"{wheel.name}: the core, no debug symbols")
    packages = [sdist, *wheels]
    version.check_versions(packages)
    _twine(packages)
    _run([*jobs, *_trials([*wheels, pure][0], found[0], folder / "extras")])
    return packages, lacking


def _twine(packages: list[Path]) -> None:
    words = [sys.executable, "-m", "twine", "check", "--strict", *map(str, packages)]
    done = subprocess.run(
        words, capture_output=True, text=True, check=False, env={**os.environ, "NO_COLOR": "1"}
    )
    if done.returncode:
        raise Wrong(f"twine check says:\n{done.stdout}")
    _say("twine check --strict passed")


def _use(python: pythons.Python, wheel: Path, folder: Path, *, with_core: bool) -> str:
    what = f"Python {python}, {'with' if with_core else 'without'} the core"
    if with_core and (reason := python.why_no_core()):
        return f"{what}: not for it, {reason}"
    heard_s = first_use.try_wheel(wheel, python, folder / f"{python}-{with_core}", with_core=with_core)
    return f"{what}: from nothing to 'I heard' in {heard_s:.1f} s"


def _trials(wheel: Path, python: pythons.Python, folder: Path) -> Iterator[_Job]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    offered = project["optional-dependencies"]
    if unknown := offered.keys() - extras.FOR_DEVELOPERS - extras.TRIALS.keys():
        raise Wrong(f"no program tries the extra {', '.join(sorted(unknown))}")
    for extra in extras.TRIALS:
        yield partial(_try_extra, wheel, extra, offered[extra], python, folder / extra)


def _try_extra(wheel: Path, extra: str, requirements: list[str], python: pythons.Python, folder: Path) -> str:
    trial = extras.TRIALS[extra]
    if not extras.applies(requirements, python.version):
        return f"busd[{extra}]: nothing of it is for this machine and Python {python}"
    environment = first_use.Environment(python, folder)
    environment.install(str(wheel))
    extras.check_refusal(environment, trial)
    environment.install(f"{wheel}[{extra}]")
    extras.try_extra(environment, trial)
    return f"busd[{extra}]: bus {' '.join(trial.words)}"


def _run(jobs: list[_Job]) -> None:
    """Run the jobs, as many at once as there are processors, and print what came of them. Raises Wrong."""
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        begun = [threads.submit(job) for job in jobs]
        try:
            for one in begun:
                try:
                    _say(one.result())
                except Missing as error:
                    _say(f"left out: {error}")
        finally:
            for one in begun:
                one.cancel()


def _say(text: str) -> None:
    print(text, flush=True)


if __name__ == "__main__":
    sys.exit(main())
