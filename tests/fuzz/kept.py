"""The kept inputs: a file for each target, an input a line, in base64.

tests/native/fuzz.h reads them, too.
"""

from base64 import b64decode, b64encode
from collections.abc import Iterable
from pathlib import Path

HERE = Path(__file__).parent
CORPUS = HERE / "corpus"
CRASHES = HERE / "crashes"
"""Inputs that once made a target fail."""


def inputs(folder: Path, name: str) -> list[bytes]:
    """The inputs in CORPUS or CRASHES for one target."""
    path = folder / f"{name}.txt"
    return [b64decode(line) for line in path.read_text().splitlines()] if path.exists() else []


def keep(folder: Path, name: str, kept: Iterable[bytes]) -> None:
    """Replace the kept inputs by these."""
    lines = [b64encode(data).decode() for data in sorted(set(kept), key=lambda data: (len(data), data))]
    folder.mkdir(exist_ok=True)
    (folder / f"{name}.txt").write_text("".join(f"{line}\n" for line in lines))
