"""`python -m benchmarks.write RESULT.json` writes the report, its pictures and tables, and README's table."""

import argparse
import sys
from pathlib import Path

from benchmarks import markdown, pictures
from benchmarks.machine import ROOT
from benchmarks.report import Result, Unreadable, load

REPORT = ROOT / "benchmarks" / "REPORT.md"
README = ROOT / "README.md"


def main() -> int:
    """Write all; returns 0, 1 if the pictures could not be drawn, 2 if the result is not usable."""
    options = _parser().parse_args()
    path: Path = options.result.absolute()
    try:
        result = load(path)
        if options.preview:
            _preview(result, path, options.preview)
        else:
            _publish(result, path)
    except (Unreadable, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    folder = (options.preview or REPORT.parent) / markdown.FOLDER
    try:
        drawn = pictures.draw(result, folder)
    except ImportError as error:
        print(f"no pictures, they need `pip install -e '.[bench]'`: {error}", file=sys.stderr)
        return 1
    names = {one.name for one in drawn}
    for old in folder.glob("*.svg"):
        if old.name not in names:
            old.unlink()
    print(f"written: {folder.parent} and {len(drawn)} pictures")
    return 0


def _publish(result: Result, path: Path) -> None:
    if result.is_quick:
        raise ValueError(f"{path.name} is of a quick run: the report is made from a full one (or --preview)")
    if not path.is_relative_to(REPORT.parent):
        raise ValueError(f"{path.name} is not in benchmarks/results, so nobody else could look at it")
    source = path.relative_to(REPORT.parent).as_posix()
    readme = markdown.with_speed(README.read_text(), markdown.speed_of(result))
    REPORT.write_text(markdown.report_of(result, source))
    (REPORT.parent / markdown.TABLES).write_text(markdown.tables_of(result, source))
    README.write_text(readme)


def _preview(result: Result, path: Path, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / REPORT.name).write_text(markdown.report_of(result, path.name))
    (folder / markdown.TABLES).write_text(markdown.tables_of(result, path.name))
    (folder / "speed.md").write_text(markdown.speed_of(result) + "\n")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.write",
        description="Make REPORT.md, TABLES.md, the pictures, and the table in README.md from one result.",
    )
    parser.add_argument("result", type=Path, metavar="RESULT.json")
    parser.add_argument("--preview", type=Path, metavar="FOLDER", help="write all there, and no README")
    return parser


if __name__ == "__main__":
    sys.exit(main())
