"""The files of this tree: those under version control, or in a source distribution all that it has."""

import shutil
import subprocess
from pathlib import Path

__all__ = ["ROOT", "copy_tree", "tracked", "why_not_tracked"]

ROOT = Path(__file__).parents[2]
_NOT_COPIED = (".*", "__pycache__", "*.egg-info", "*.so", "*.py[cod]", "build", "dist")


def why_not_tracked() -> str:
    """Why git can't list the files of this tree, in a few words; "" if it can."""
    if not (ROOT / ".git").exists():
        return "this tree is not a git checkout"
    if not shutil.which("git"):
        return "git is not installed"
    done = _git("rev-parse", "--is-inside-work-tree")
    return f"git says: {done.stderr.strip()}" if done.returncode else ""


def tracked() -> set[str]:
    """Files under version control that belong into the source distribution: none that begins with a dot."""
    names = _git("ls-files", "-z").stdout.split("\0")
    return {
        name
        for name in names
        if name and not any(part.startswith(".") for part in name.split("/")) and (ROOT / name).exists()
    }


def copy_tree(folder: Path) -> None:
    """Copy the tree, without what editable installs and earlier builds left in it."""
    if why_not_tracked():
        shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*_NOT_COPIED))
        return
    for name in tracked():
        copy = folder / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, copy)


def _git(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["git", "-C", ROOT, *words], capture_output=True, text=True, check=False)
