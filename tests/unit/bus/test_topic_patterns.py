import pytest

from bus.errors import ConfigurationError
from bus.topic_patterns import compiled
from rows import for_each


@for_each(
    "pattern, name, matches",
    [
        ("/a", "/a", True),
        ("/a", "/ab", False),
        ("/*", "/a", True),
        ("/*", "/a/b", False),
        ("/**", "/a/b", True),
        ("**", "/a/b", True),
        ("/a?", "/ab", True),
        ("/a?", "/a/", False),
        ("/[ab]", "/b", True),
        ("/[!ab]", "/b", False),
    ],
)
def test_patterns(pattern: str, name: str, matches: bool) -> None:
    assert bool(compiled(pattern, "allow").fullmatch(name)) is matches


@for_each("pattern", ["a", "", "/a/", "/a//b", "/a b", "/[b-a]"])
def test_patterns_that_can_never_match(pattern: str) -> None:
    with pytest.raises(ConfigurationError, match="can never match"):
        compiled(pattern, "allow")
