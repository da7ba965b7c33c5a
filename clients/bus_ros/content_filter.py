"""Content filters: the part of DDS's filter expressions that compares fields of a message with values.

    speed > 1.5 AND header.frame_id = %0
    NOT (id BETWEEN 3 AND %1) OR name LIKE 'cam%'

Fields are named with dots; `%0` ... `%99` stand for parameters. Owns the grammar and its meaning. Must not
know subscriptions.
"""

import operator
import re
from collections.abc import Callable, Sequence
from typing import Any, Final, TypeAlias

from bus.base.suggest import did_you_mean

__all__ = ["FilterError", "compile_filter"]

Value: TypeAlias = Callable[[Any], Any]

_TOKEN: Final = re.compile(
    r"\s*(?:(?P<number>[-+]?(?:\d+\.\d*|\.\d+|\d+)(?:[eE][-+]?\d+)?)|'(?P<text>[^']*)'|%(?P<parameter>\d{1,2})"
    r"|(?P<word>[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)|(?P<sign><>|!=|<=|>=|=|<|>|\(|\)))"
)
_COMPARISONS: Final[dict[str, Callable[[Any, Any], bool]]] = {
    "=": operator.eq,
    "<>": operator.ne,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_WORDS: Final = ("AND", "OR", "NOT", "BETWEEN", "LIKE", "TRUE", "FALSE")
MAX_LENGTH: Final = 10_000
MAX_DEPTH: Final = 50
MAX_PARAMETERS: Final = 100


class FilterError(ValueError):
    """An invalid expression; the text says where."""


def compile_filter(expression: str, parameters: Sequence[str], example: object) -> Callable[[Any], bool]:
    """A function that returns whether a message passes the filter.

    `example` is any message of the type: a field that it lacks is an error. Raises FilterError. A message
    does not pass if the compared values can't be compared, for example a text and a number.
    """
    if len(expression) > MAX_LENGTH or len(parameters) > MAX_PARAMETERS:
        raise FilterError(
            f"the expression may have {MAX_LENGTH} characters and {MAX_PARAMETERS} parameters at most"
        )
    condition = _Parser(expression, parameters, example).parse()

    def passes(message: Any) -> bool:
        try:
            return bool(condition(message))
        except TypeError:
            return False

    return passes


class _Parser:
    """A parser for one expression, which it reads once from left to right."""

    def __init__(self, expression: str, parameters: Sequence[str], example: object) -> None:
        self._parameters = parameters
        self._example = example
        self._depth = 0
        self._tokens: list[tuple[str, str, int]] = []
        end = 0
        while expression[end:].strip():
            found = _TOKEN.match(expression, end)
            if found is None:
                raise FilterError(
                    f"'{expression}' is no filter: what begins at column {end + 1} can't be read"
                )
            kind = str(found.lastgroup)
            text, column = found[kind], found.start(kind) + 1
            if kind == "word" and text.upper() in _WORDS:
                kind, text = "keyword", text.upper()
            self._tokens.append((kind, text, column))
            end = found.end()
        self._tokens.append(("end", "", len(expression) + 1))
        self._expression = expression
        self._index = 0

    def parse(self) -> Value:
        condition = self._any()
        if self._tokens[self._index][0] != "end":
            self._fail("AND, OR or the end")
        return condition

    def _any(self) -> Value:
        parts = [self._all()]
        while self._takes("keyword", "OR"):
            parts.append(self._all())
        return parts[0] if len(parts) == 1 else lambda message: any(part(message) for part in parts)

    def _all(self) -> Value:
        parts = [self._one()]
        while self._takes("keyword", "AND"):
            parts.append(self._one())
        return parts[0] if len(parts) == 1 else lambda message: all(part(message) for part in parts)

    def _one(self) -> Value:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise FilterError(f"the expression is nested deeper than {MAX_DEPTH}")
        if self._takes("keyword", "NOT"):
            inner = self._one()
            found: Value = lambda message: not inner(message)  # noqa: E731
        elif self._takes("sign", "("):
            found = self._any()
            if not self._takes("sign", ")"):
                self._fail("')'")
        else:
            found = self._comparison()
        self._depth -= 1
        return found

    def _comparison(self) -> Value:
        left = self._value()
        kind, text, _ = self._tokens[self._index]
        negated = self._takes("keyword", "NOT")
        if self._takes("keyword", "BETWEEN"):
            low = self._value()
            if not self._takes("keyword", "AND"):
                self._fail("AND")
            high = self._value()
            between: Value = lambda message: low(message) <= left(message) <= high(message)  # noqa: E731
            return (lambda message: not between(message)) if negated else between
        if negated:
            self._fail("BETWEEN")
        if self._takes("keyword", "LIKE"):
            pattern = self._value()
            return lambda message: _is_like(left(message), pattern(message))
        if kind != "sign" or text not in _COMPARISONS:
            self._fail("a comparison")
        self._index += 1
        compare, right = _COMPARISONS[text], self._value()
        return lambda message: compare(left(message), right(message))

    def _value(self) -> Value:
        kind, text, _ = self._tokens[self._index]
        if kind == "word":
            self._index += 1
            return self._field(text)
        if kind == "parameter":
            number = int(text)
            if number >= len(self._parameters):
                raise FilterError(f"there is no parameter %{number}: there are {len(self._parameters)}")
            constant = _literal(self._parameters[number])
        elif kind in ("number", "text"):
            constant = text if kind == "text" else _number(text)
        elif text in ("TRUE", "FALSE"):
            constant = text == "TRUE"
        else:
            self._fail("a field or a value")
        self._index += 1
        return lambda message: constant

    def _field(self, path: str) -> Value:
        value = self._example
        for name in path.split("."):
            fields: dict[str, str] = getattr(type(value), "get_fields_and_field_types", dict)()
            if name not in fields:
                raise FilterError(f"the message has no field '{path}'{did_you_mean(name, fields)}")
            value = getattr(value, name)
        return operator.attrgetter(path)

    def _takes(self, kind: str, text: str) -> bool:
        is_it = self._tokens[self._index][:2] == (kind, text)
        self._index += is_it
        return is_it

    def _fail(self, wanted: str) -> Any:
        column = self._tokens[self._index][2]
        raise FilterError(f"'{self._expression}' is no filter: {wanted} is missing at column {column}")


def _number(text: str) -> int | float:
    return int(text) if re.fullmatch(r"[-+]?\d+", text) else float(text)


def _literal(parameter: str) -> Any:
    """The value of a parameter's text: `'abc'`, `3`, `1.5`, TRUE, or any other text as it is."""
    text = parameter.strip()
    if len(text) >= 2 and text[0] == text[-1] == "'":
        return text[1:-1]
    if text.upper() in ("TRUE", "FALSE"):
        return text.upper() == "TRUE"
    try:
        return _number(text)
    except ValueError:
        return parameter


def _is_like(value: object, pattern: object) -> bool:
    """Whether a value matches a LIKE pattern: `%` and `*` stand for any letters, `_` and `?` for one."""
    if not isinstance(value, str) or not isinstance(pattern, str):
        return False
    parts = (".*" if letter in "%*" else "." if letter in "_?" else re.escape(letter) for letter in pattern)
    return re.fullmatch("".join(parts), value, re.DOTALL) is not None
