"""The checks of `make wheels` find the faults that they look for; the search for Pythons."""

import sys
from collections.abc import Callable
from pathlib import Path
from zipfile import ZipFile

import pytest

import pythons
from rows import for_each
from wheels import Wrong, extras
from wheels.contents import check_wheel

INFO = "busd-1.2.3.dist-info"
PURE, NATIVE = "py3-none-any", "cp311-abi3-manylinux_2_28_x86_64"
CORE = "bus/shm/_core.abi3.so"
OTHER = {"bus_tf2/core/_core.abi3.so": "", "bus_bag/core/_core.abi3.so": ""}

Make = Callable[..., Path]


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A minimal tree, with a file of each kind."""
    tree = tmp_path / "tree"
    for name in (
        "busd/run.py",
        "clients/bus/py.typed",
        "clients/bus/shm/py_module.c",
        "clients/bus/shm/py.h",
        "clients/bus/shm/ring.h",
        "clients/c/src/session.c",
        "clients/cpp/include/busd/busd.hpp",
    ):
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).touch()
    return tree


@pytest.fixture
def make(tmp_path: Path) -> Make:
    def make_wheel(
        tag: str, more: dict[str, str], without: str = "", page: str = "# busd", said: str = ""
    ) -> Path:
        files = {
            "busd/run.py": "",
            "bus/py.typed": "",
            "bus_c/bus/shm/ring.h": "",
            "bus_c/c/src/session.c": "",
            "bus_c/cpp/include/busd/busd.hpp": "",
            f"{INFO}/METADATA": f"Name: busd\n\n{page}\n",
            f"{INFO}/WHEEL": f"Wheel-Version: 1.0\nTag: {said or tag}\n",
            f"{INFO}/licenses/LICENSE": "",
            **more,
        }
        path = tmp_path / f"busd-1.2.3-{tag}.whl"
        with ZipFile(path, "w") as archive:
            for name, text in files.items():
                if name != without:
                    archive.writestr(name, text)
        return path

    return make_wheel


def test_wheels_that_are_right(tree: Path, make: Make) -> None:
    check_wheel(make(PURE, {}), tree, with_core=False)
    check_wheel(make(NATIVE, {CORE: "/dev/null /proc/self", **OTHER}), tree, with_core=True)


@pytest.mark.parametrize(
    ("tag", "more", "others", "fault"),
    [
        (PURE, {"bus/shm/ring.h": ""}, {}, "has what it should not: bus/shm/ring.h"),
        (PURE, {"bus/left_over.py": ""}, {}, "has what it should not: bus/left_over.py"),
        (PURE, {"bus_c/bus/shm/py.h": ""}, {}, "has what it should not: bus_c/bus/shm/py.h"),
        (PURE, {}, {"without": "bus/py.typed"}, "lacks bus/py.typed"),
        (PURE, {}, {"without": "bus_c/bus/shm/ring.h"}, "lacks bus_c/bus/shm/ring.h"),
        (PURE, {}, {"without": "bus_c/c/src/session.c"}, "lacks bus_c/c/src/session.c"),
        (PURE, {}, {"without": f"{INFO}/licenses/LICENSE"}, "has no licence"),
        (PURE, {CORE: ""}, {}, "has 1 native cores, wanted: 0"),
        (NATIVE, {}, {}, "says cp311-abi3-manylinux_2_28_x86_64, wanted: py3-none-any"),
        (PURE, {}, {"said": "cp311-abi3-linux_x86_64"}, "says cp311-abi3-linux_x86_64"),
        (PURE, {}, {"page": "see [qos](docs/qos.md)"}, r"links that lead nowhere on an index: \[qos\]"),
    ],
)
def test_a_pure_wheel_that_is_wrong(
    tree: Path, make: Make, tag: str, more: dict[str, str], others: dict[str, str], fault: str
) -> None:
    with pytest.raises(Wrong, match=fault):
        check_wheel(make(tag, more, **others), tree, with_core=False)


@pytest.mark.parametrize(
    ("tag", "more", "fault"),
    [
        (NATIVE, OTHER, "has 2 native cores, wanted: 3"),
        (
            "cp311-abi3-linux_x86_64",
            {CORE: "", **OTHER},
            "says cp311-abi3-linux_x86_64, wanted: cp311-abi3-manylinux",
        ),
        ("cp311-abi3-manylinux_2_29_x86_64", {CORE: "", **OTHER}, r"needs glibc 2\.29, wanted: 2\.28"),
        (NATIVE, {CORE: "\0/home/me/python/lib\0", **OTHER}, f"{CORE} names /home/me/python/lib"),
    ],
)
def test_a_native_wheel_that_is_wrong(
    tree: Path, make: Make, tag: str, more: dict[str, str], fault: str
) -> None:
    with pytest.raises(Wrong, match=fault):
        check_wheel(make(tag, more), tree, with_core=True)


def test_this_python_is_found() -> None:
    found = pythons.find()
    assert sys.version_info[:2] in {python.version[:2] for python in found}
    names = [python.name for python in found]
    assert len(names) == len(set(names))
    assert set(pythons.missing(found)) == set(pythons.WANTED) - set(names)


def test_programs_that_are_no_python_are_passed_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """For example, pyenv has a shim for each version, although the version is not chosen."""
    for name, text in {"python3.15": "#!/bin/sh\nexit 127\n", "python3.16": "no program"}.items():
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    assert not {"3.15", "3.16"} & {python.name for python in pythons.find()}


@for_each(
    ("said", "package"),
    [
        ("ERROR: No matching distribution found for msgspec>=0.19", "msgspec"),
        (
            "  ERROR: Failed building wheel for numpy\nERROR: Failed to build installable wheels (numpy)",
            "numpy",
        ),
        ("ERROR: Failed to build 'aiohttp' when getting requirements to build wheel", "aiohttp"),
        ("  ERROR: Failed building wheel for busd\nERROR: Failed to build installable wheels (busd)", ""),
        ("ERROR: Could not install packages due to an OSError", ""),
    ],
)
def test_a_package_that_another_python_can_not_have(said: str, package: str) -> None:
    assert pythons.lacking_package(said, (3, 99, 0)) == package
    assert pythons.lacking_package(said, sys.version_info[:3]) == ""


def test_an_extra_applies_if_one_of_its_packages_does() -> None:
    old = "cyclonedds>=11; python_version < '3.14'"
    assert extras.applies([old], (3, 13, 1))
    assert not extras.applies([old], (3, 14, 0))
    assert extras.applies([old, "numpy"], (3, 14, 0))
