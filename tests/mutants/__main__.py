"""`python -m mutants [WORD ...]`: breaks one line after the other in copies of the tree, and runs its tests.

There is a copy for each processor.

With words: only mutants with one of the words in their file or description. Fails if the tests pass
nevertheless (the mutant survived) or can't be run, if the line does not exist exactly once, or if the tests
fail on the unbroken tree.
"""

import ast
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

import msgspec

ROOT = Path(__file__).parents[2]
LIMIT_S = 100
"""The longest run of a mutant's tests; longer, and they hang."""
LIMIT_OF_ALL_S = 1200
"""The longest run of all these tests on the unbroken tree."""
_KILLED, _SURVIVED, _NOT_RUN = "killed", "SURVIVED", "NOT RUN"
_FAILED = 1
"""pytest's status if tests failed; it has others if they could not be run."""
_FOLDERS = ("busd", "clients", "tests", "examples", "benchmarks", "docs")
_FILES = (
    "pyproject.toml",
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "Makefile",
    "MANIFEST.in",
    "SECURITY.md",
    "setup.py",
)
_NATIVE = "tests/native/"
_CORES = ("clients/bus/shm/", "clients/bus_bag/core/")


class Mutant(msgspec.Struct, forbid_unknown_fields=True):
    """A line to break, the effect, and the tests of which at least one must fail: files, or `file::test`."""

    breaks: str
    file: str
    old: str
    new: str
    tests: list[str]

    @property
    def is_in_core(self) -> bool:
        """Whether the native core has to be built again with it."""
        is_built = self.file.startswith(_CORES) and not self.file.endswith(".py")
        return is_built and not all(test.startswith(_NATIVE) for test in self.tests)


def main(words: list[str]) -> int:
    mutants = read()
    if words:
        mutants = [one for one in mutants if any(word in f"{one.file} {one.breaks}" for word in words)]
    stale = [mistake for one in mutants for mistake in mistakes(one)]
    if stale:
        print(*stale, sep="\n")
        return 1
    with tempfile.TemporaryDirectory() as folder:
        first, *others = trees = [Path(folder) / str(number) for number in range(os.cpu_count() or 1)]
        _copy(first)
        if any(one.is_in_core for one in mutants):
            _build_core(first)
        tests = sorted({test for one in mutants for test in one.tests})
        if report := _report_of_unbroken(first, tests):
            print(f"the tests fail on the unbroken tree:\n{report}")
            return 1
        for tree in others:
            shutil.copytree(first, tree)
        found = _outcomes(trees, mutants)
    print(f"{len(mutants)} mutants, {found[_SURVIVED]} survived, {found[_NOT_RUN]} not run")
    return found[_KILLED] < len(mutants)


def read() -> list[Mutant]:
    data = tomllib.loads((Path(__file__).parent / "mutants.toml").read_text())
    return msgspec.convert(data["mutant"], list[Mutant])


def mistakes(mutant: Mutant) -> list[str]:
    """Mismatches between the mutant and the tree: in its line, and in its tests."""
    source = (ROOT / mutant.file).read_text()
    found = [f"no such test: {test}" for test in mutant.tests if not _is_there(test)]
    if source.count(mutant.old) != 1:
        found.append(f"not there once: {mutant.file}: {mutant.old!r} ({mutant.breaks})")
    elif mutant.file.endswith(".py"):
        try:
            ast.parse(source.replace(mutant.old, mutant.new))
        except SyntaxError as error:
            found.append(f"no Python any more: {mutant.file}: {error} ({mutant.breaks})")
    return found


def _copy(tree: Path) -> None:
    ignored = shutil.ignore_patterns("__pycache__", "build", "results")
    for name in _FOLDERS:
        shutil.copytree(ROOT / name, tree / name, ignore=ignored)
    for name in _FILES:
        shutil.copy2(ROOT / name, tree)


def _outcomes(trees: list[Path], mutants: list[Mutant]) -> Counter[str]:
    """How many mutants have each outcome. In each tree, one after the other is made."""
    free: SimpleQueue[Path] = SimpleQueue()
    for tree in trees:
        free.put(tree)

    def outcome(mutant: Mutant) -> str:
        tree = free.get()
        try:
            return _outcome(tree, mutant)
        finally:
            free.put(tree)

    with ThreadPoolExecutor(len(trees)) as pool:
        return Counter(pool.map(outcome, mutants))


def _outcome(tree: Path, mutant: Mutant) -> str:
    path, began = tree / mutant.file, time.monotonic()
    source = path.read_text()
    built = [core for folder in _CORES for core in (tree / folder).glob("*.so")] if mutant.is_in_core else []
    cores = {core: core.read_bytes() for core in built}
    path.write_text(source.replace(mutant.old, mutant.new))
    try:
        if mutant.is_in_core:
            _build_core(tree)
        word = _KILLED if _fails(tree, mutant.tests) else _SURVIVED
    except RuntimeError as error:
        print(error)
        word = _NOT_RUN
    finally:
        path.write_text(source)
        for core, content in cores.items():
            core.write_bytes(content)
    print(f"{word:<8} {time.monotonic() - began:5.1f} s  {mutant.file}: {mutant.breaks}", flush=True)
    return word


def _build_core(tree: Path) -> None:
    """Build the core in the copy; only setup.py knows the compiler's options."""
    done = subprocess.run(
        [sys.executable, "setup.py", "-q", "build_ext", "--inplace"],
        cwd=tree,
        env=os.environ | {"BUS_NATIVE": "yes", "CFLAGS": "-O0"},
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"the native core could not be built:\n{done.stderr}")


def _is_there(test: str) -> bool:
    file, _, name = test.partition("::")
    path = ROOT / file
    return path.is_file() and (not name or f"def {name}(" in path.read_text())


def _report_of_unbroken(tree: Path, tests: list[str]) -> str:
    """The failures of these tests in the copy, which is not broken; "" if there are none."""
    native, others = _parted(tests)
    failed = [name for name in native if _native_fails(tree, name)]
    if failed:
        return "\n".join(failed)
    try:
        done = _pytest(tree, others, LIMIT_OF_ALL_S, "-n", str(os.cpu_count()))
    except subprocess.TimeoutExpired:
        return f"they did not end within {LIMIT_OF_ALL_S} s"
    return done.stdout if done.returncode else ""


def _fails(tree: Path, tests: list[str]) -> bool:
    """Whether one of these tests fails in the copy."""
    native, others = _parted(tests)
    return any(_native_fails(tree, name) for name in native) or (bool(others) and _pytest_fails(tree, others))


def _parted(tests: list[str]) -> tuple[list[str], list[str]]:
    """The names of the tests in C, and the paths of the others."""
    native = [Path(test).stem for test in tests if test.startswith(_NATIVE)]
    return native, [test for test in tests if not test.startswith(_NATIVE)]


def _native_fails(tree: Path, name: str) -> bool:
    folder, program = tree / _NATIVE, f"build/plain/{name}"
    subprocess.run(["make", "-s", "-C", folder, program, "CFLAGS=-Wno-error"], check=True, timeout=LIMIT_S)
    kept = [tree / "tests" / "fuzz" / "corpus" / f"{name.removeprefix('fuzz_')}.txt"]
    command = [folder / program, *(path for path in kept if path.exists())]
    try:
        return bool(subprocess.run(command, capture_output=True, timeout=LIMIT_S, check=False).returncode)
    except subprocess.TimeoutExpired:
        return True


def _pytest_fails(tree: Path, tests: list[str]) -> bool:
    try:
        done = _pytest(tree, tests, LIMIT_S, "-x", "-n", "0")
    except subprocess.TimeoutExpired:
        return True  # it hangs
    if done.returncode > _FAILED:
        raise RuntimeError(f"the tests could not be run:\n{done.stdout}\n{done.stderr}")
    return done.returncode != 0  # below 0: the core has crashed


def _pytest(tree: Path, tests: list[str], limit_s: float, *options: str) -> subprocess.CompletedProcess[str]:
    paths = os.pathsep.join([str(tree), str(tree / "clients")])
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "--landing", *options, "-p", "no:cacheprovider", *tests],
        cwd=tree,
        env=os.environ | {"PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=limit_s,
        check=False,
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
