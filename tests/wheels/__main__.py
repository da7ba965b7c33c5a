"""`python -m wheels --into dist`: makes sdist and wheels and checks them. Exit status 1: one is wrong."""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import pythons
from wheels import Wrong, building, contents, first_use
from wheels.building import ROOT


def main() -> int:
    parser = argparse.ArgumentParser(prog="wheels", description=__doc__)
    parser.add_argument("--into", type=Path, default=ROOT / "dist", help="where they are put (default: dist)")
    into = parser.parse_args().into
    with tempfile.TemporaryDirectory(prefix="wheels-") as name:
        try:
            packages = _make(Path(name))
        except Wrong as error:
            print(f"wheels: {error}", file=sys.stderr)
            return 1
        into.mkdir(exist_ok=True)
        for old in into.glob("busd-*"):
            old.unlink()
        for package in packages:
            shutil.copy(package, into)
            print(f"{package.stat().st_size / 1e3:8.0f} kB  {into / package.name}")
    return 0


def _make(folder: Path) -> list[Path]:
    """Build and check everything below `folder`."""
    sdist, tree = building.build_sdist(folder)
    contents.check_sdist(sdist, tree)
    _say(f"{sdist.name}: has all of the tree")
    pure = building.build_wheel(sdist, folder / "pure", BUS_NATIVE="no")
    contents.check_wheel(pure, tree, with_core=False)
    # Where the compiler fails, pip makes the same; what it prints of the compiler's fault is no fault here.
    failed = building.build_wheel(sdist, folder / "failed", may_warn=True, CC="false")
    contents.check_wheel(failed, tree, with_core=False)
    _say(f"{pure.name}: no core in it, and none where the compiler fails")
    wheels = {pure: False}
    if shutil.which(building.compiler()):
        # Python's own flags for the linker may say where it has its libraries, for RUNPATH.
        link = f"{building.compiler()} -shared"
        built = building.build_wheel(sdist, folder / "native", BUS_NATIVE="yes", LDSHARED=link)
        native = building.make_manylinux(built, folder / "manylinux")
        contents.check_wheel(native, tree, with_core=True)
        wheels[native] = True
        _say(f"{native.name}: the core, no debug symbols")
    else:
        _say("no C compiler: the wheel with the native core is left out")
    packages = [sdist, *wheels]
    _twine(packages)
    _use(wheels, folder)
    return packages


def _twine(packages: list[Path]) -> None:
    words = [sys.executable, "-m", "twine", "check", "--strict", *map(str, packages)]
    done = subprocess.run(
        words, capture_output=True, text=True, check=False, env={**os.environ, "NO_COLOR": "1"}
    )
    if done.returncode:
        raise Wrong(f"twine check says:\n{done.stdout}")
    _say("twine check --strict passed")


def _use(wheels: dict[Path, bool], folder: Path) -> None:
    found = pythons.find()
    for number, python in enumerate(found):
        for wheel, with_core in wheels.items():
            what = "with" if with_core else "without"
            if with_core and (reason := python.why_no_core()):
                _say(f"Python {python}, {what} the core: not for it, {reason}")
                continue
            place = folder / "use" / f"{number}{what}"
            heard_s = first_use.try_wheel(wheel, python, place, with_core=with_core)
            _say(f"Python {python}, {what} the core: from nothing to 'I heard' in {heard_s:.1f} s")
    for name in pythons.missing(found):
        _say(f"Python {name}: not found")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = set(project["optional-dependencies"]) - first_use.FOR_DEVELOPERS
    if unknown := extras - set(first_use.EXTRAS):
        raise Wrong(f"no command tries the extra {', '.join(sorted(unknown))}")
    for extra in sorted(extras):
        first_use.try_extra(list(wheels)[-1], extra, found[0], folder / "extras" / extra)
        _say(f"busd[{extra}]: bus {' '.join(first_use.EXTRAS[extra])}")


def _say(text: str) -> None:
    print(text, flush=True)


if __name__ == "__main__":
    sys.exit(main())
