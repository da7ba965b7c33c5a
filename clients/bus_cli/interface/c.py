"""`bus interface c`: a C header for a message type."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from bus_cli.interface.show import add_type, given_name
from bus_cli.output import CommandError, say


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FOLDER",
        help="Write FOLDER/PKG/msg/Type.h and print its path. Default: the header on stdout",
    )
    add_type(parser, "A message type (e.g. 'std_msgs/msg/String')")


def main(args: Namespace) -> int:
    name = given_name(args.type)
    text = _header(name)
    if args.output is None:
        say(text.rstrip("\n"))
        return 0
    path = args.output / f"{name}.h"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    except OSError as error:
        raise CommandError(f"can't write {path}: {error.strerror}") from None
    say(str(path))
    return 0


def _header(name: str) -> str:
    from bus.schema import MessageSchema
    from bus.types.support import find_type
    from bus_cli.interface.c_header import UnsupportedType, header

    if name.split("/")[1] != "msg":
        raise CommandError(f"{name} is no message type; `bus interface c` writes headers of message types")
    message_type = find_type(name)
    if message_type is None:
        raise CommandError(f"{name} has no definition")
    schema = MessageSchema.of(message_type)
    try:
        return header(schema.description, schema.type_name, schema.type_hash, schema.encoded)
    except UnsupportedType as error:
        raise CommandError(str(error)) from None
