"""Paths in the pages exist: links, and files and folders in code spans, short ones (`wire/`) too."""

import re
from collections.abc import Iterator
from pathlib import Path

from rows import for_each

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    str(path.relative_to(ROOT))
    for folder in ("", "docs", "benchmarks")
    for path in (ROOT / folder).glob("*.md")
)

FENCE = re.compile(r"^(?:`([^`\n]+)`[^`\n]*:\n\n)?(```\w*\n.*?^```)$", re.MULTILINE | re.DOTALL)
"""A fenced block, with the name of the file that it shows."""
CODE = re.compile(r"`([^`\n]+)`")
LINK = re.compile(r"\[[^\]]+\]\(([^)#]+)[^)]*\)")
SECTIONS = re.compile(r"^(?=##)", re.MULTILINE)
BLOCKS = re.compile(r"\n\s*\n|\n(?=[|]|\s*[-*] )")
"""The breaks between paragraphs, rows of tables, items of lists."""

FILE = re.compile(r"[\w.-]+\.(c|cfg|css|h|html|js|json|md|png|py|pyi|svg|toml|txt|xml|yaml)")
WITH_FOLDER = re.compile(r"\.?\w[\w.-]*(/[\w.*-]+)*/|\w[\w.-]*(/[\w.*-]+)+")
TYPE = re.compile(r"\w+/(?:(?:msg|srv|action)/)?[A-Z]\w*")
"""A message type such as `std_msgs/msg/String`."""

OF_USERS = {"CMakeLists.txt", "busd.toml", "metadata.yaml", "package.xml", "resource/", "setup.cfg"}
"""Files and folders of users, not of this tree."""
MADE = {".fuzz/", "dist/"}
"""Folders made by targets of make."""
NO_PATHS = {
    "docs/bag.md": {"events/write_split"},
    "docs/bridge.md": {"quic/", "tcp/", "tls/"},
    "docs/configuration.md": {"camera/*"},
    "docs/faq.md": {"bus.py"},
    "docs/lesson.md": {
        *("lc_talker/change_state", "lc_talker/get_state"),
        *("carrot.py", "client_member_function.py", "past.py", "service_member_function.py"),
    },
    "docs/look.md": {"b/s", "lost/s"},
    "docs/protocol.md": {"talker.py"},
    "docs/running.md": {"lib/PKG/EXE", "test/"},
}
"""Exceptions by page: names of topics and services, kinds of addresses, units, and files of the reader."""


def wrong_paths(page: str, text: str) -> list[str]:
    """Paths in `text`, the page at `page`, that do not exist.

    A path in a code span starts at the root of the tree, in the folder of the page, in a folder or package
    that its paragraph, row or item names, or beside a file that this names. If it names no folder, the path
    may start in one that the section names. Files of the user, in fenced blocks, need not exist.
    """
    here = ROOT / page
    fences = FENCE.findall(text)
    of_users = OF_USERS | MADE | NO_PATHS.get(page, set()) | {name for name, _ in fences}
    in_fences = "".join(block for _, block in fences)
    prose = FENCE.sub("", text)
    lost = [target for target in LINK.findall(prose) if not _leads(target, [here.parent])]
    for section in SECTIONS.split(prose):
        named = list(_folders(section, here.parent))
        for block in BLOCKS.split(section):
            places = [ROOT, here.parent, *(list(_folders(block, here.parent)) or named)]
            places += [(ROOT / span).parent for span in CODE.findall(block) if (ROOT / span).is_file()]
            lost += [
                span
                for span in CODE.findall(block)
                if (FILE.fullmatch(span) or WITH_FOLDER.fullmatch(span))
                and not TYPE.fullmatch(span)
                and span not in of_users
                and Path(span).name not in in_fences
                and not _leads(span, places)
            ]
    return lost


def _leads(path: str, places: list[Path]) -> bool:
    return path.startswith("https://") or any(any(place.glob(path)) for place in places)


def _folders(text: str, page_folder: Path) -> Iterator[Path]:
    """Folders that `text` names, by their paths or as packages."""
    for span in CODE.findall(text):
        package = span.replace(".", "/")
        for path in (ROOT / span, page_folder / span, ROOT / package, ROOT / "clients" / package):
            if path.is_dir():
                yield path


@for_each("page", PAGES)
def test_every_path_of_a_page_leads_somewhere(page: str) -> None:
    assert wrong_paths(page, (ROOT / page).read_text()) == []


def test_contributing_names_every_package_and_every_folder_of_tests() -> None:
    tree = (ROOT / "CONTRIBUTING.md").read_text().partition("## The tree")[2].partition("\n##")[0]
    rows = [line for line in tree.splitlines() if line.startswith("| `")]
    packages = {f"clients/{path.name}/" for path in (ROOT / "clients").iterdir() if path.is_dir()}
    assert packages <= {span for row in rows for span in CODE.findall(row.split("|")[1])}
    (tests,) = [row for row in rows if row.startswith("| `tests/`")]
    folders = {f"{path.parent.name}/" for path in (ROOT / "tests").glob("*/*.py")} | {"native/"}
    assert folders <= set(CODE.findall(tests))


@for_each(
    ("text", "lost"),
    [
        ("`wire/` of `clients/bus/`", []),
        ("`clients/bus/`, with `wire/` and `cli/`", ["cli/"]),
        ("| `clients/bus/` | the facade (`rclpy/`) |\n| `clients/bus_ros/` | (`rclpy/`) |", ["rclpy/"]),
        ("`bus.wire` has `runs.py` and `no_runs.py`", ["no_runs.py"]),
        ("`docs/qos.md` and `docs/qos.txt`", ["docs/qos.txt"]),
        ("[here](qos.md), [there](missing.md), [elsewhere](https://example.org/x)", ["missing.md"]),
        ("`mine.py`:\n\n```python\nimport bus\n```\n\n`yours.py`", ["yours.py"]),
        ("A `std_msgs/msg/String` on `/topic`, by `busd.toml`", []),
        ("## `clients/bus/`\n\nIn `wire/`\n\n## Other\n\nIn `wire/`", ["wire/"]),
    ],
)
def test_what_leads_nowhere_is_found(text: str, lost: list[str]) -> None:
    assert wrong_paths("docs/page.md", text) == lost
