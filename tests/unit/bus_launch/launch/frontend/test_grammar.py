"""Text with substitutions: plain text, names and arguments, and errors."""

import pytest

from bus_launch.launch.core import Substitution, TextSubstitution
from bus_launch.launch.frontend.grammar import parse
from rows import for_each


class _Call(Substitution):
    def __init__(self, name: str, arguments: list[list[Substitution]]) -> None:
        self.text = f"{name}({', '.join(shown(one) for one in arguments)})"


def shown(found: list[Substitution]) -> str:
    return "+".join(
        f"'{one.text}'" if isinstance(one, TextSubstitution) else one.text  # type: ignore[attr-defined]
        for one in found
    )


@for_each(
    ("text", "meaning"),
    [
        ("", "''"),
        ("plain text", "'plain text'"),
        ("$(dirname)", "dirname()"),
        ("$( var  x )", "var('x')"),
        ("$(var x)/b", "var('x')+'/b'"),
        ("a$(var x)$(env Y z)", "'a'+var('x')+env('Y', 'z')"),
        ("$(find-pkg-share my_pkg)/x.yaml", "find-pkg-share('my_pkg')+'/x.yaml'"),
        ("$(var $(var x))", "var(var('x'))"),
        ("$(var a$(var x)b)", "var('a'+var('x')+'b')"),
        ("$(eval '1 + 1')", "eval('1 + 1')"),
        ('$(eval "1 + 1")', "eval('1 + 1')"),
        ("$(eval '$(var n) > 2')", "eval(var('n')+' > 2')"),
        (r"$(eval '\'$(var c)\' == 2')", "eval('''+var('c')+'' == 2')"),
        ("$(eval '\"a b\" in x')", "eval('\"a b\" in x')"),
        ("$(command 'ls (x)' warn)", "command('ls (x)', 'warn')"),
        ("$(env X '')", "env('X', '')"),
        (r"\$(var x)", "'$(var x)'"),
        ("costs $5", "'costs $5'"),
        ("a)b", "'a)b'"),
    ],
)
def test_texts(text: str, meaning: str) -> None:
    assert shown(parse(text, _Call)) == meaning


@for_each(
    ("text", "problem"),
    [
        ("$(var x", r"'\$\(var x' is not closed by '\)'"),
        ("a $(var 'x)", "a ' is not closed"),
        ("$()", "not followed by a substitution's name"),
        ("$(" + "var $(" * 60, "more than 50 substitutions"),
    ],
)
def test_mistakes(text: str, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        parse(text, _Call)


def test_many_substitutions_may_stand_side_by_side() -> None:
    text = "$(var x)" * 100
    assert shown(parse(text, _Call)) == "+".join(["var('x')"] * 100)
