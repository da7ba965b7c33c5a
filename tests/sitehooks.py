"""Hooks of mkdocs for the site (mkdocs.yml): pages from outside docs/, links to files, tables, anchors.

The site has the files of docs/ under their names, and the files of `SHOWN` under `project/` and their paths.
"""

import posixpath
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from pymdownx.slugs import slugify

ROOT = Path(__file__).parents[1]
SHOWN = ("*.md", "benchmarks/*.md", "benchmarks/pictures/*.svg")
LEFT_OUT = {"PACKAGE.md"}
"""The page of a package index."""

_ICON = ROOT / "clients" / "bus_web" / "page" / "icon.svg"
_DOCS = "docs/"
_PROJECT = "project/"
_CODE_OR_LINK = re.compile(
    r"(?P<code>^ *```.*?^ *```$|`[^`\n]+`)|\[(?P<text>[^\]]+)\]\((?P<path>[^)#:\s]+)(?P<anchor>#[^)\s]*)?\)",
    re.MULTILINE | re.DOTALL,
)
_CELL = re.compile(r"<t[dh]\b.*?</t[dh]>", re.DOTALL)
_EMPTY_HEAD = re.compile(r"<th([^>]*)></th>")
_PICTURE = re.compile(
    r'<picture><source media="\(prefers-color-scheme: dark\)" srcset="(?P<dark>[^"]*)">'
    r'<img alt="(?P<alt>[^"]*)" src="(?P<light>[^"]*)"></picture>'
)


def on_config(config: MkDocsConfig) -> None:
    """Anchors of headings, as git hosts make them."""
    config.mdx_configs["toc"]["slugify"] = slugify(case="lower")


def on_files(files: Files, config: MkDocsConfig) -> None:
    """Add the files from outside docs/, and the icon."""
    files.append(File.generated(config, "assets/icon.svg", abs_src_path=str(_ICON)))
    for path in (path for pattern in SHOWN for path in sorted(ROOT.glob(pattern))):
        if path.name not in LEFT_OUT:
            name = to_site(path.relative_to(ROOT).as_posix())
            files.append(File.generated(config, name, abs_src_path=str(path)))


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn links between files of the tree into links between files of the site.

    If the text of a link is the name of a file, the link shows the title of the page. A link to a file that
    the site does not have becomes the path of the file. mkdocs reports a link to a file that does not exist.
    """
    here = page.file.src_uri
    if page.is_homepage:
        page.meta["hide"] = ["navigation"]  # it is the navigation

    def change(found: re.Match[str]) -> str:
        if found["code"]:
            return found[0]
        target = posixpath.normpath(posixpath.join(posixpath.dirname(to_tree(here)), found["path"]))
        text, anchor = found["text"], found["anchor"] or ""
        file = files.get_file_from_path(to_site(target))
        if file is None:
            return _as_path(text, target) if (ROOT / target).exists() else found[0]
        if text.endswith(posixpath.basename(target)) and file.page is not None and file.page.title:
            text = str(file.page.title)
        return f"[{text}]({posixpath.relpath(file.src_uri, posixpath.dirname(here))}{anchor})"

    markdown = _CODE_OR_LINK.sub(change, markdown).replace("<details>", "<details markdown>")
    return _PICTURE.sub(_by_palette, markdown)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Mend tables: in code, Python's Markdown leaves the backslash of `\\|`. An empty cell is no head."""
    html = _CELL.sub(lambda found: found[0].replace(r"\|", "|"), html)
    return _EMPTY_HEAD.sub(r"<td\1></td>", html)


def to_site(path: str) -> str:
    """Name on the site of a file of the tree."""
    return path.removeprefix(_DOCS) if path.startswith(_DOCS) else _PROJECT + path


def to_tree(name: str) -> str:
    """Path in the tree of a file of the site."""
    return name.removeprefix(_PROJECT) if name.startswith(_PROJECT) else _DOCS + name


def _as_path(text: str, path: str) -> str:
    return f"`{path}`" if path.endswith(text) else f"{text} (`{path}`)"


def _by_palette(found: re.Match[str]) -> str:
    """Two pictures for two palettes. The theme shows the one of the palette that the reader has chosen."""
    return "".join(
        f'<img alt="{found["alt"]}" src="{found[shade]}#only-{shade}">' for shade in ("light", "dark")
    )
