"""Pages of docs/ with claims: tables of "claim | shown by" that name the tests."""

import ast
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"

_NAMED = re.compile(r"`(tests/[\w/]+\.py)::([\w:]+)`")
_ROW = re.compile(r"^\| (.+?) \| (.+) \|$", re.MULTILINE)


def named_tests(page: str) -> list[tuple[str, str]]:
    """File and name of each test, as pytest has them."""
    return _NAMED.findall(page)


def claims(page: str) -> list[tuple[str, str]]:
    """The rows of all such tables, with the named tests."""
    found = []
    for block in re.findall(r"(?:^\|.*\|\n)+", page, re.MULTILINE):
        head, *rows = _ROW.findall(block)
        if head[1] == "shown by":
            found += rows
    return found


@cache
def names_in(path: str) -> set[str]:
    """The names of a file's tests, as pytest has them, without the file."""
    found = set()
    for node in ast.parse((ROOT / path).read_text()).body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            found.add(node.name)
        elif isinstance(node, ast.ClassDef):
            found |= {
                f"{node.name}::{one.name}"
                for one in node.body
                if isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef)
            }
    return {name for name in found if name.rpartition("::")[2].startswith("test_")}
