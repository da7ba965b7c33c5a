"""Every promise in docs/reliability.md names a test that exists, and its table of fuzzers is complete."""

import re

from claims import DOCS, claims, named_tests, names_in
from fuzz.kept import CORPUS
from rows import for_each

PAGE = (DOCS / "reliability.md").read_text()
NAMED = named_tests(PAGE)


@for_each(("path", "name"), NAMED)
def test_the_test_exists(path: str, name: str) -> None:
    assert name in names_in(path)


def test_every_promise_names_one() -> None:
    found = claims(PAGE)
    assert [claim for claim, shown in found if not named_tests(shown)] == []
    assert len(found) > 30


def test_the_table_of_fuzzers_has_all_targets() -> None:
    table = PAGE.partition("| target | input | must be true |\n")[2].partition("\n\n")[0]
    cells = re.findall(r"^\| (.+?) \|", table, re.MULTILINE)
    named = {name for cell in cells for name in re.findall(r"`(\w+)`", cell)}
    assert named == {path.stem for path in CORPUS.iterdir()}
