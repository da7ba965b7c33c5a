"""Arguments of launch files: reading them from the command line, and listing them."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from bus_cli.output import CommandError

__all__ = ["given_arguments", "listed", "misspelt"]


def given_arguments(words: Sequence[str]) -> dict[str, str]:
    """Read `name:=value` words. If a name occurs several times, the last value counts."""
    found: dict[str, str] = {}
    for word in words:
        name, equals, value = word.partition(":=")
        if not name or not equals or (not value and word.count(":=") == 1):
            raise CommandError(f"malformed launch argument '{word}', expected format '<name>:=<value>'")
        found[name] = value
    return found


def misspelt(given: Iterable[str], description: Any) -> Iterator[str]:
    """A line for each name that a file does not declare but that is similar to a declared one.

    Other names are not mistakes, because a launch configuration need not be declared. `description` is the
    launch description of the file, or None.
    """
    if description is None:
        return
    declared = [one.name for one in description.get_launch_arguments()]
    for name in given:
        if name not in declared:
            from bus.base.suggest import did_you_mean

            if near := did_you_mean(name, declared):
                yield f"the launch file declares no argument '{name}'{near}"


def listed(arguments: Iterable[Any]) -> Iterator[str]:
    """The lines of --show-args."""
    yield "Arguments (pass arguments as '<name>:=<value>'):"
    is_any = has_conditional = False
    for one in arguments:
        is_any = True
        star = ""
        if one._conditionally_included:
            star, has_conditional = "*", True
        yield f"\n    '{one.name}':{star}"
        yield f"        {one.description}"
        if one.default_value is not None:
            yield f"        (default: {' + '.join(part.describe() for part in one.default_value)})"
    if not is_any:
        yield "\n  No arguments."
    elif has_conditional:
        yield "\n* argument(s) which are only used if specific conditions occur"
