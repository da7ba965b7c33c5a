"""The site of the pages: its navigation, links and tables, and nothing that comes from another host."""

import re
from hashlib import sha256
from html.parser import HTMLParser
from pathlib import Path

import pytest

from docsite import DOCS, build, page_of, parts_of_index, parts_of_site
from rows import for_each

BLOCKS = {*("h1", "h2", "h3", "h4", "h5", "h6"), "ul", "ol", "li", "table", "tr", "td", "pre", "blockquote"}
REFERENCE = re.compile(r'<(\w+)\b[^>]*?\s(?:src|href)="([^"]*)"')
FENCE = re.compile(r"^ *```.*?^ *```$", re.MULTILINE | re.DOTALL)
NESTED = re.compile(r"^ {1,3}(?:[-*]|\d+\.) .*", re.MULTILINE)
ARTICLE = re.compile(r"<article[^>]*>(.*)</article>", re.DOTALL)


def test_the_navigation_is_the_tables_of_the_index() -> None:
    assert parts_of_site() == parts_of_index()
    assert list(parts_of_index()) == ["Tutorials", "How-to", "Reference", "Explanation", "Project"]


def test_every_page_is_in_one_part() -> None:
    listed = [path for pages in parts_of_index().values() for _, path in pages]
    assert sorted(path for path in listed if not path.startswith("../")) == sorted(
        path.name for path in DOCS.glob("*.md") if path.name != "README.md"
    )
    assert [path for path in listed if not (DOCS / path).is_file()] == []


def test_nested_lists_have_four_spaces() -> None:
    """With fewer, mkdocs shows them as one list."""
    pages = [DOCS / path for pages in parts_of_index().values() for _, path in pages]
    assert {
        page.name: found for page in pages if (found := NESTED.findall(FENCE.sub("", page.read_text())))
    } == {}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built strictly: a dead link, a dead anchor or a page outside the navigation is an error."""
    return build(tmp_path_factory.mktemp("site"))


@pytest.mark.nightly
def test_all_that_a_page_loads_is_in_the_site(site: Path) -> None:
    """Links of HTML too, which mkdocs does not check, and nothing from other hosts."""
    lost, far = set(), set()
    for page in site.rglob("*.html"):
        for tag, target in REFERENCE.findall(page.read_text()):
            path = target.partition("#")[0].partition("?")[0]
            if ":" in target:
                far.update([target] * (tag != "a" and not target.startswith("data:")))
            elif path and page.name != "404.html" and not (page.parent / path).exists():
                lost.add((page.name, target))
    assert (lost, far) == (set(), set())


@pytest.mark.nightly
def test_a_page_has_the_blocks_that_a_git_host_shows(site: Path) -> None:
    """Python's Markdown differs from theirs. For example, it wants four spaces before a nested list."""
    pytest.importorskip("markdown_it", reason="markdown-it-py reads Markdown as git hosts do")
    from markdown_it import MarkdownIt

    markdown = MarkdownIt("commonmark").enable("table")
    paths = ["README.md", *(path for pages in parts_of_index().values() for _, path in pages)]
    differing = []
    for path in paths:
        body = ARTICLE.search((site / page_of(path)).read_text())
        assert body, path
        if _Blocks(body[1]).found != _Blocks(markdown.render((DOCS / path).read_text())).found:
            differing.append(path)
    assert differing == []


class _Blocks(HTMLParser):
    """The opening and closing tags of blocks, in their order. The head of a table has cells like its rows."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attributes: object) -> None:
        self._add(tag, "")

    def handle_endtag(self, tag: str) -> None:
        self._add(tag, "/")

    def _add(self, tag: str, slash: str) -> None:
        tag = "td" if tag == "th" else tag
        if tag in BLOCKS:
            self.found.append(slash + tag)


def test_what_comes_from_others_is_as_it_was_published() -> None:
    vendor = DOCS / "assets" / "vendor"
    lines = (vendor / "versions.txt").read_text().splitlines()
    told = {name: digest for digest, name in (line.split()[:2] for line in lines if not line.startswith("#"))}
    there = {path.name: sha256(path.read_bytes()).hexdigest() for path in vendor.iterdir()}
    there.pop("versions.txt")
    assert told == there, "`make vendor` writes both"


@pytest.mark.nightly
def test_links_and_tables_are_those_of_the_site(site: Path) -> None:
    """See tests/sitehooks.py."""
    shown = {path: (site / page_of(path)).read_text() for path in ("look.md", "cdr.md", "../CONTRIBUTING.md")}
    assert "layers in <code>examples/robot</code> is a process" in " ".join(shown["look.md"].split())
    assert "<code>T | None</code>" in shown["cdr.md"]
    assert '<a href="CHANGELOG.html">Changelog</a>' in shown["../CONTRIBUTING.md"]
    assert "Apache License 2.0 (<code>LICENSE</code>)" in shown["../CONTRIBUTING.md"]
    assert '<a href="../architecture.html">' in shown["../CONTRIBUTING.md"]


@for_each(
    ("path", "page"),
    [
        ("README.md", "index.html"),
        ("qos.md", "qos.html"),
        ("../CHANGELOG.md", "project/CHANGELOG.html"),
        ("../benchmarks/README.md", "project/benchmarks/index.html"),
    ],
)
def test_places_of_pages(path: str, page: str) -> None:
    assert page_of(path) == page
