"""docs/api.md has every public name of `bus`, each with the text of its current docstring."""

import ast
import difflib
import re

import apipage
import bus
from apipage import NAMED
from apisource import entries
from rows import for_each

PUBLIC = entries()


def test_the_page_is_made_of_the_docstrings_of_today() -> None:
    here, made = apipage.PAGE.read_text().splitlines(), apipage.page().splitlines()
    changed = list(difflib.unified_diff(here, made, "docs/api.md", "the docstrings", lineterm="", n=0))
    assert not changed, "docs/api.md is not what the docstrings say; run: make api\n" + "\n".join(
        changed[:20]
    )


def test_links_in_the_page_lead_somewhere() -> None:
    text = re.sub(r"^```.*?^```$", "", apipage.PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^##+ (.*)$", text, re.MULTILINE)
    there = [re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles]
    assert len(there) == len(set(there)) > 100
    assert set(re.findall(r"\]\(#(.*?)\)", text)) <= set(there)


@for_each("name", bus.__all__)
def test_every_name_has_a_group(name: str) -> None:
    assert name in NAMED, f"bus.{name} is in no group of docs/api.md: add it to GROUPS in tests/apipage.py"


def test_the_groups_have_each_name_once_and_no_other() -> None:
    assert sorted(NAMED) == sorted(set(NAMED))
    assert [path for path in NAMED if path not in PUBLIC] == []


@for_each("path", PUBLIC)
def test_every_name_has_a_docstring(path: str) -> None:
    one = PUBLIC[path]
    assert one.doc, f"bus.{path} has no docstring (a text below it, where it is an attribute)"
    assert one.signature or one.kind != "attribute", f"say the type of bus.{path} where it is set"


@for_each("path", [path for path, one in PUBLIC.items() if one.kind in ("class", "enum")])
def test_every_class_has_a_line_of_example(path: str) -> None:
    if not issubclass(getattr(bus, path), BaseException):
        (*_, example) = apipage.examples(PUBLIC[path]) or [""]
        assert example, (
            f"the docstring of bus.{path} shows no use: write 'For example:', and below it indented"
        )


@for_each("path", PUBLIC)
def test_lines_of_example_can_be_parsed(path: str) -> None:
    for example in apipage.examples(PUBLIC[path]):
        compile(example, path, "exec", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)


@for_each("name", [name for name in bus.__all__ if isinstance(getattr(bus, name), type)])
def test_classes_offer_no_more_than_the_page_has(name: str) -> None:
    """tests/system/test_api_page.py tests the same with live objects."""
    cls = getattr(bus, name)
    of_python = {one for base in cls.__mro__ if not base.__module__.startswith("bus.") for one in dir(base)}
    offered = {one for one in dir(cls) if not one.startswith("_")} - of_python
    assert offered <= {member.name for member in PUBLIC[name].members}
