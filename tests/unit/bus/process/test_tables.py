"""bus.process.tables: the texts of errors about a file, a key and a value."""

from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import pytest

from bus.errors import ConfigurationError
from bus.process.tables import check_keys, checked, each_of, filled, read_file
from rows import for_each


class Cup(msgspec.Struct, frozen=True):
    colour: Literal["red", "blue"]
    litres: Annotated[float, msgspec.Meta(gt=0)] | None = None


def test_a_table_becomes_a_struct() -> None:
    assert filled("cup", {"colour": "red", "litres": 1}, Cup) == Cup("red", 1.0)
    assert [*each_of("cups", [{}, {"a": 1}])] == [("cups[0]", {}), ("cups[1]", {"a": 1})]
    assert [*each_of("cups", [])] == []


@for_each(
    ("table", "said"),
    [
        (7, "cup: expected a table, got 7"),
        ({}, "cup: 'colour' is missing"),
        ({"color": "red"}, "unknown key 'cup.color'; did you mean 'colour'?"),
        ({"x": 1}, "unknown key 'cup.x' (known: colour, litres)"),
        ({"colour": "green"}, "cup.colour = 'green': expected one of red, blue"),
        ({"colour": 3}, "cup.colour = 3: expected `str`, got `int`"),
        ({"colour": "red", "litres": 0}, "cup.litres = 0: expected `float` > 0.0"),
        ({"colour": "red", "litres": "x" * 90}, f"cup.litres = '{'x' * 56}...: expected `float`, got `str`"),
    ],
)
def test_refusals(table: object, said: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        filled("cup", table, Cup)
    assert str(caught.value) == said


@for_each(
    ("kind", "value", "said"),
    [
        (Literal["a", "b"] | None, "c", "x = 'c': expected one of a, b"),
        (str | None, 3, "x = 3: expected `str`, got `int`"),
    ],
)
def test_a_value(kind: Any, value: object, said: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        checked("x", value, kind)
    assert str(caught.value) == said


def test_a_key_that_belongs_elsewhere_is_named_with_its_table() -> None:
    with pytest.raises(ConfigurationError, match=r"^unknown key 'depth'; did you mean 'limits.depth'\?$"):
        check_keys("", {"depth": 1}, {"limits": "limits"}, elsewhere={"depth": "limits.depth"})


def test_no_array() -> None:
    with pytest.raises(
        ConfigurationError, match=r"^cups: expected an array of tables, each under \[\[cups\]\]$"
    ):
        [*each_of("cups", {})]


def test_a_file(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_text("a = 1\n[b]\nc = 'd'\n")
    assert read_file(path) == {"a": 1, "b": {"c": "d"}}
    path.write_text("a = ")
    with pytest.raises(
        ConfigurationError, match=r"x\.toml: not valid TOML: Invalid value \(at end of document\)"
    ):
        read_file(path)
    with pytest.raises(ConfigurationError, match=r"y\.toml: can't be read: No such file"):
        read_file(tmp_path / "y.toml")
