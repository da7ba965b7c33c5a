"""`bus interface show`: the text of a definition."""

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from typing import Any

from bus_cli.completion import completed_by
from bus_cli.output import CommandError, print_json, say


def add_arguments(parser: ArgumentParser) -> None:
    comments = parser.add_mutually_exclusive_group()
    comments.add_argument(
        "--all-comments",
        action="store_true",
        help="Show all comments, including for nested interface definitions",
    )
    comments.add_argument("--no-comments", action="store_true", help="Show no comments or whitespace")
    add_type(
        parser, "Show an interface definition (e.g. 'example_interfaces/msg/String'); - reads it from stdin"
    )


def add_type(parser: ArgumentParser, text: str, *, is_optional: bool = False) -> None:
    """Add the argument that names a definition."""
    completed_by(parser.add_argument("type", nargs="?" if is_optional else None, help=text), _types)


def main(args: Namespace) -> int:
    name = given_name(sys.stdin.readline().strip() if args.type == "-" else args.type)
    lines = list(_lines(name, comments=not args.no_comments, nested_comments=args.all_comments))
    if args.json:
        print_json({"type": name, "definition": "\n".join(lines)})
        return 0
    for line in lines:
        say(line)
    return 0


def given_name(text: str) -> str:
    """The full name of the definition that the user means.

    Raises CommandError with ros2's text if there is none.
    """
    from bus.errors import ConfigurationError
    from bus.types.definitions import definition_path, full_name, names

    if text and "/" not in text:
        return _only_one_called(text)
    parts = text.split("/")
    if len(parts) not in (2, 3):
        raise CommandError(f"Invalid name '{text}'. Expected three parts separated by '/'")
    if not all(parts):
        raise CommandError(f"Invalid name '{text}'. Must not contain empty parts")
    name = full_name(text)
    name = name.removesuffix(f".{name.split('/')[1]}")
    try:
        definition_path(name)
    except ConfigurationError as error:
        if not names(package=parts[0]):
            from bus_cli.suggestions import near_interface_package

            near = near_interface_package(parts[0])
            raise CommandError(f"Unknown package '{parts[0]}'{near}") from None
        _, hint, near = str(error).partition("; did you mean")
        raise CommandError(f"Could not find the interface '{name}'{hint}{near}") from None
    return name


def _only_one_called(short: str) -> str:
    """The full name of the only definition with a short name such as `String`."""
    from bus.types.definitions import names
    from bus_cli.suggestions import near_type, types_called

    found = types_called(short, names())
    if len(found) > 1:
        raise CommandError(f"'{short}' may be {' or '.join(found)}: write one of them")
    if not found:
        wrong = f"Invalid name '{short}'. Expected three parts separated by '/'"
        raise CommandError(f"{wrong}{near_type(short, None)}")
    return found[0]


def _lines(name: str, *, comments: bool, nested_comments: bool, above: tuple[str, ...] = ()) -> Iterator[str]:
    """Lines of a definition. The definition of a field's type follows the field, one tab further right."""
    from bus.types.definitions import definition_path, find_definition
    from bus.types.idl import Message, code_of

    if name in above:
        raise CommandError(f"{name} contains itself: {' -> '.join((*above, name))}")
    above, indent = (*above, name), "\t" * len(above)
    definition = find_definition(name)
    messages = [definition] if isinstance(definition, Message) else definition[1:]
    nested = {field.line: field.type.base for message in messages for field in message.fields}
    text = definition_path(name).read_text("utf-8").removeprefix("\ufeff").removesuffix("\n")
    for number, line in enumerate(text.split("\n"), 1):
        shown = line.rstrip() if comments else code_of(line)
        if shown or comments:
            yield f"{indent}{shown}" if shown else ""
        if "/" in (base := nested.get(number, "")):
            yield from _lines(base, comments=nested_comments, nested_comments=nested_comments, above=above)


def _types(**_: Any) -> list[str]:
    from bus.types.definitions import names

    return names()
