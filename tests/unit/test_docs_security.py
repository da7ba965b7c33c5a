"""Every claim in docs/security.md names a test that exists, and the recipe for access has the effect that it
describes.
"""

from pathlib import Path

import pytest

from busd.config.file import load
from busd.core.access import Access, Action, Subject
from claims import DOCS, claims, named_tests, names_in
from rows import for_each

PAGE = (DOCS / "security.md").read_text()
NAMED = named_tests(PAGE)

OWN, ALICE, BOB, ROBOT = 1000, 1001, 1002, 500


@for_each(("path", "name"), NAMED)
def test_the_test_exists(path: str, name: str) -> None:
    assert name in names_in(path)


def test_every_claim_names_one() -> None:
    found = claims(PAGE)
    assert [claim for claim, shown in found if not named_tests(shown)] == []
    assert len(found) > 25


def test_each_test_of_access_is_for_a_claim_or_says_what_it_is_for() -> None:
    """The tests with hostile users exist for this page, so it must name all of them."""
    named = {name for path, name in NAMED if path == "tests/system/test_access_memory.py"}
    assert named == names_in("tests/system/test_access_memory.py")


@pytest.mark.parametrize(
    ("action", "topic", "alice", "bob"),
    [
        ("publish", "/rosout", True, True),
        ("subscribe", "/parameter_events", True, True),
        ("subscribe", "/camera/left/image_raw", True, False),
        ("publish", "/camera/left/image_raw", False, False),
        ("publish", "/cmd_vel", True, False),
        ("subscribe", "/cmd_vel", False, False),
        ("subscribe", "/planner/get_parameters/_request", True, False),
        ("publish", "/planner/get_parameters/_reply", True, False),
        ("observe", "/secret", False, False),
    ],
)
def test_the_recipe_for_another_users_node(
    tmp_path: Path, action: Action, topic: str, alice: bool, bob: bool
) -> None:
    """The recipe is in docs/configuration.md. Numbers replace names that this machine does not have."""
    page = (DOCS / "configuration.md").read_text()
    recipe = page.partition("\n### `[[access]]`\n")[2].partition("```toml\n")[2].partition("```")[0]
    path = tmp_path / "busd.toml"
    path.write_text(recipe.replace('"alice"', str(ALICE)).replace('"robot"', str(ROBOT)))
    config = load(path)
    assert (config.socket.mode, config.socket.gid) == (0o660, ROBOT)
    access = Access(OWN, config.access)
    in_group = frozenset({ROBOT})
    assert access.decide(Subject(ALICE, in_group), action, topic).is_allowed == alice
    assert access.decide(Subject(BOB, in_group), action, topic).is_allowed == bob
    assert not access.may_connect(Subject(BOB, frozenset({BOB})))
