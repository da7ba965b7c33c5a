"""Text with substitutions, as attributes hold it: `$(find-pkg-share my_robot)/$(var name 'a b')`.

Pure: text in, substitutions out. A substitution's arguments stand between blanks; each is text,
substitutions, or both; in quotes it may hold blanks. A backslash takes the next character as it is.
"""

import re
from collections.abc import Callable
from typing import Final

from bus_launch.launch.core import Substitution, TextSubstitution
from bus_launch.launch.errors import short

__all__ = ["parse_if_substitutions", "parse_substitution", "replace_escaped_characters"]

_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")
_ESCAPED: Final = re.compile(r"\\(.)", re.DOTALL)
_DEEPEST: Final = 50

Make = Callable[[str, list[list[Substitution]]], Substitution]


def replace_escaped_characters(data: str) -> str:
    return _ESCAPED.sub(r"\1", data)


def parse_substitution(string_value: str) -> list[Substitution]:
    """Raises ValueError for `$(` that is not closed, RuntimeError for an unknown name."""
    from bus_launch.launch.frontend.expose import instantiate_substitution

    return parse(string_value, instantiate_substitution)


def parse_if_substitutions(value: object) -> object:
    """The substitutions of a text, or the text if it has none; the same for each item of a list."""
    if isinstance(value, list):
        return [parse_if_substitutions(one) for one in value]
    if not isinstance(value, str):
        return value
    found = parse_substitution(value)
    if len(found) == 1 and isinstance(found[0], TextSubstitution):
        return found[0].text
    return found


def parse(text: str, make: Make) -> list[Substitution]:
    """Like `parse_substitution`; `make` makes the substitution of a name and its arguments."""
    reader = _Reader(text, make)
    found, _ = reader.read("")
    return found or [TextSubstitution(text="")]


class _Reader:
    def __init__(self, text: str, make: Make) -> None:
        self._text = text
        self._make = make
        self._at = 0
        self._depth = 0

    def read(self, ends: str) -> tuple[list[Substitution], bool]:
        """Text and substitutions up to one of the characters `ends`; and whether something stood there."""
        found: list[Substitution] = []
        plain = ""
        start = self._at
        while self._at < len(self._text):
            char = self._text[self._at]
            if char in ends:
                break
            if char == "\\" and self._at + 1 < len(self._text):
                plain += self._text[self._at + 1]
                self._at += 2
            elif self._text.startswith("$(", self._at):
                if plain:
                    found.append(TextSubstitution(text=plain))
                    plain = ""
                found.append(self._substitution())
            else:
                plain += char
                self._at += 1
        if plain:
            found.append(TextSubstitution(text=plain))
        return found, self._at > start

    def _substitution(self) -> Substitution:
        start = self._at
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ValueError(f"more than {_DEEPEST} substitutions inside each other in {short(self._text)}")
        self._at += 2
        self._skip_blanks()
        name = _NAME.match(self._text, self._at)
        if name is None:
            raise ValueError(f"'$(' is not followed by a substitution's name in {short(self._text)}")
        self._at = name.end()
        arguments: list[list[Substitution]] = []
        while True:
            self._skip_blanks()
            if self._at >= len(self._text):
                raise ValueError(f"{short(self._text[start:])} is not closed by ')'")
            if self._text[self._at] == ")":
                break
            arguments.append(self._argument())
        self._at += 1
        self._depth -= 1
        return self._make(name[0], arguments)

    def _argument(self) -> list[Substitution]:
        quote = self._text[self._at]
        if quote not in "'\"":
            return self.read(" \t\n)")[0]
        self._at += 1
        found, _ = self.read(quote)
        if self._at >= len(self._text):
            raise ValueError(f"a {quote} is not closed in {short(self._text)}")
        self._at += 1
        return found or [TextSubstitution(text="")]

    def _skip_blanks(self) -> None:
        while self._at < len(self._text) and self._text[self._at] in " \t\n":
            self._at += 1
