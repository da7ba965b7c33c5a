"""What is in the packages, file for file, and whether their names and pages tell the truth."""

import re
import tarfile
from email import message_from_bytes
from pathlib import Path, PurePosixPath
from zipfile import ZipFile

from wheels import Wrong

__all__ = ["check_sdist", "check_wheel", "files_of"]

_CORE = re.compile(r"(bus/shm|bus_tf2/core|bus_bag/core)/_core\.abi3\.so")
_CORES = 3
_NEWEST_GLIBC = 28  # minor number: of the systems with Python 3.11, those of the last years have it
_SOURCES = (".c", ".h")
_IN_C = ("c/", "cpp/")
"""Clients in other languages: a wheel has them in a folder of their own."""
_C_FOLDER = "bus_c"
_FOR_C = re.compile(r"bus/shm/(?!p)\w+\.h|bus/base/version\.py")
"""Files of the library that they need."""
_FROM_BUILD = re.compile(r"PKG-INFO|setup\.cfg|busd\.egg-info/.*")
_PATH = re.compile(rb"(?<![\w.])/(?!dev/|proc/)\w{2,}(?:/[\w.+-]{2,})+")
_LINK = re.compile(r"\[[^\]\n]+\]\((?!https?:|#)[^)]*\)")
_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)


def check_sdist(sdist: Path, files: set[str]) -> None:
    """Raise Wrong unless it has these files of the tree and no other."""
    with tarfile.open(sdist) as archive:
        there = {name.partition("/")[2] for name in archive.getnames() if not archive.getmember(name).isdir()}
    there = {name for name in there if not _FROM_BUILD.fullmatch(name)}
    _compare(sdist.name, {name for name in files if not _FROM_BUILD.fullmatch(name)}, there)


def check_wheel(wheel: Path, tree: Path, *, with_core: bool) -> None:
    """It has all of the packages but their C, and the client for C; it says whether it needs this platform,
    and knows no folder of ours."""
    info = "-".join(wheel.name.split("-")[:2]) + ".dist-info/"
    with ZipFile(wheel) as archive:
        files = {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}
    there = {name for name in files if not name.startswith(info)}
    cores = {name for name in there if _CORE.fullmatch(name)}
    wanted = {f"busd/{name}" for name in files_of(tree / "busd")}
    clients = files_of(tree / "clients")
    wanted |= {name for name in clients if not name.startswith(_IN_C)}
    wanted = {name for name in wanted if not name.endswith(_SOURCES)}
    wanted |= {f"{_C_FOLDER}/{name}" for name in clients if name.startswith(_IN_C) or _FOR_C.fullmatch(name)}
    _compare(wheel.name, wanted, there - cores)
    if len(cores) != _CORES * with_core:
        raise Wrong(f"{wheel.name} has {len(cores)} native cores, wanted: {_CORES * with_core}")
    _check_tags(wheel, message_from_bytes(files[f"{info}WHEEL"]).get_all("Tag", []), with_core=with_core)
    for name in cores:
        if paths := _PATH.findall(files[name]):
            raise Wrong(f"{wheel.name}: {name} names {b', '.join(paths).decode()}")
    if f"{info}licenses/LICENSE" not in files:
        raise Wrong(f"{wheel.name} has no licence")
    page = _FENCE.sub("", files[f"{info}METADATA"].decode().partition("\n\n")[2])
    if dead := _LINK.findall(page):
        raise Wrong(f"{wheel.name}: links that lead nowhere on an index: {', '.join(dead)}")


def _check_tags(wheel: Path, tags: list[str], *, with_core: bool) -> None:
    pattern = r"cp311-abi3-manylinux_2_\d+_\w+" if with_core else "py3-none-any"
    said = wheel.name.removesuffix(".whl").split("-", 2)[2]
    for tag in [*tags, *said.split(".")[:1]]:
        if not re.fullmatch(pattern, tag):
            raise Wrong(f"{wheel.name} says {tag}, wanted: {pattern}")
        if (glibc := re.search(r"manylinux_2_(\d+)_", tag)) and int(glibc[1]) > _NEWEST_GLIBC:
            raise Wrong(
                f"{wheel.name} needs glibc 2.{glibc[1]}, wanted: 2.{_NEWEST_GLIBC} (`auditwheel show`)"
            )


def files_of(folder: Path) -> set[str]:
    """Paths of all files in a copy of the tree, or in a folder of it, except those that begin with a dot."""
    return {
        str(PurePosixPath(path.relative_to(folder)))
        for path in folder.rglob("*")
        if path.is_file() and not path.name.startswith(".")
    }


def _compare(name: str, wanted: set[str], there: set[str]) -> None:
    if lacking := sorted(wanted - there):
        raise Wrong(f"{name} lacks {', '.join(lacking[:10])}")
    if more := sorted(there - wanted):
        raise Wrong(f"{name} has what it should not: {', '.join(more[:10])}")
