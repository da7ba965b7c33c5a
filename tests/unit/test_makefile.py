"""The Makefile: each line is one that make understands, and no target lost its commands.

make takes a line that begins with a colon for a rule without targets, and says nothing.
"""

import re
from itertools import pairwise
from pathlib import Path

LINES = (Path(__file__).parents[2] / "Makefile").read_text().splitlines()


def test_each_line_begins_a_rule_or_a_definition_or_belongs_to_one() -> None:
    begun, wrong = False, []
    for line in LINES:
        if not begun and line and not re.match(r"[\t#A-Za-z.$]", line):
            wrong.append(line)
        begun = line.endswith("\\")
    assert not wrong


def test_each_target_of_the_help_has_commands() -> None:
    """All but `setup` and `peers`, which only have prerequisites."""
    found = {
        line.partition(":")[0]
        for line, following in pairwise(LINES)
        if re.match(r"[a-z-]+:.*##", line) and not following.startswith("\t")
    }
    assert found == {"setup", "peers"}
