"""Counts sentences that a reader may have to read twice: `python tests/wording.py [--show N] [FOLDER ...]`.

CONTRIBUTING.md has the rules. The patterns are signs of a broken rule, not proof: a sentence that reads well
may stay. If more than `BOUND` of 1,000 sentences in the pages have a sign, `make lint` fails. Docstrings and
comments are only counted.
"""

import argparse
import ast
import io
import re
import signal
import subprocess
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
BOUND = 35
LONG = 32
"""More words than this make a sentence long."""

PATTERNS = {
    "what ... as a noun": (
        r"(?:^|[,;:(] ?)(?:and |but |or )?[Ww]hat (?!is|are|does|do|happens|to|a |the \w+ does)\w+ "
    ),
    "where for if": (
        r"\b[Ww]here (?:there|it|that|one|they|an?|the|nothing|nobody|neither|no|this|these|those|its|both"
        r"|all|some|any|none|busd|only|others?) "
    ),
    "who for a program": r"\b(?:who|whom|whose|nobody|somebody|anybody|everybody)\b",
    "those that": r"\b(?:those (?:that|which|who|of|it)|that (?:which|of)|ones? that|all that|all else)\b",
    "old words": (
        r"\b(?:but for|be it|hence|shall|whereby|thereby|therein|thereof|save for|as yet|ere"
        r"|nor (?:is|are))\b"
    ),
    "of its own": r"\bof (?:(?:its|their|his) own|another)\b",
    "no subject": r"^(?:Of|By|Beyond|Besides|In vain|For who|To whom|With what|As what|Such)\b",
    "comma before that": (
        r"\b(?:says?|knows?|tells|sees?|means|shows?), (?:that|whether|what|which|how)\b|, (?:as if|so that) "
    ),
}
_SIGNS = {name: re.compile(pattern) for name, pattern in PATTERNS.items()}
_ENDS = re.compile(r"(?<=[.!?:;])\s+(?=[A-Z`*\"'(]|busd? )|\n\s*\n|\n\s*[-*|]\s")
_ABBREVIATIONS = re.compile(r"\b(e\.g|i\.e|etc|vs|No|cf)\.")
_EXEMPT = {"benchmarks/REPORT.md", "benchmarks/TABLES.md"}
"""Pages that a program writes."""


class Finding(NamedTuple):
    """A sentence, the line at which its text begins, and the signs in it."""

    place: str
    line: int
    text: str
    signs: list[str]


def sentences(text: str) -> list[str]:
    """The sentences of four words or more."""
    text = _ABBREVIATIONS.sub(lambda found: found[1], text)
    parts = (" ".join(part.split()) for part in _ENDS.split(text))
    return [part for part in parts if part.count(" ") >= 3]


def signs(sentence: str) -> list[str]:
    """The names of the patterns found in `sentence`, and "long"."""
    found = [name for name, sign in _SIGNS.items() if sign.search(sentence)]
    return found + ["long"] * (len(sentence.split()) > LONG)


def of_page(text: str) -> Iterator[tuple[int, str]]:
    """Paragraphs, list items and table cells of Markdown, without blocks of code; each with its line."""
    text = re.sub(r"```.*?```|<!--.*?-->", lambda found: "\n" * found[0].count("\n"), text, flags=re.DOTALL)
    line = 1
    for block in re.split(r"(\n\s*\n|\n(?=\|)|\n(?=- ))", text):
        plain = re.sub(r"[`*]", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", block))
        for cell in re.split(r"(?<!\\)\|", plain) if block.startswith("|") else [plain]:
            yield line, cell
        line += block.count("\n")


def of_source(text: str) -> Iterator[tuple[int, str]]:
    """Docstrings and comments of Python; each with its line."""
    for node in ast.walk(ast.parse(text)):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            yield node.lineno, node.value.value
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string.lstrip("# ")


def read(paths: list[str]) -> tuple[list[Finding], list[Finding]]:
    """The sentences of the pages, then of the sources, from the files that git knows below `paths`."""
    listed = subprocess.run(
        ["git", "ls-files", "--", *paths], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    pages: list[Finding] = []
    sources: list[Finding] = []
    for name in listed:
        path = ROOT / name
        if name in _EXEMPT or "/vendor/" in name or path.suffix not in (".md", ".py") or not path.is_file():
            continue
        into, texts = (pages, of_page) if path.suffix == ".md" else (sources, of_source)
        for line, text in texts(path.read_text()):
            into.extend(Finding(name, line, one, signs(one)) for one in sentences(text))
    return pages, sources


def rate(found: list[Finding]) -> float:
    """Sentences with a sign, in 1,000."""
    return 1000 * sum(bool(one.signs) for one in found) / max(1, len(found))


def main() -> int:
    parser = argparse.ArgumentParser(description="Count sentences that may have to be read twice.")
    parser.add_argument(
        "--show", type=int, default=0, metavar="N", help="show so many of the worst sentences"
    )
    parser.add_argument("paths", nargs="*", default=["."], metavar="FOLDER", help="files and folders")
    options = parser.parse_args()
    pages, sources = read(options.paths)
    worst = sorted((one for one in (*pages, *sources) if one.signs), key=lambda one: -len(one.signs))
    for one in worst[: options.show]:
        print(f"{one.place}:{one.line}: {', '.join(one.signs)}: {one.text}")
    for kind, found in (("pages", pages), ("docstrings and comments", sources)):
        print(
            f"{kind}: {rate(found):.0f} of 1,000 sentences may have to be read twice ({len(found)} sentences)"
        )
    if rate(pages) <= BOUND:
        return 0
    print(f"The bound of the pages is {BOUND}. `python tests/wording.py --show 20 docs` shows the sentences.")
    return 1


if __name__ == "__main__":
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # `| head` ends it in silence
    sys.exit(main())
