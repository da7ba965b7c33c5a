"""`bus interface c`: a C header for a message or a service."""

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
        help="Write FOLDER/TYPE.h and print its path. Default: the header on stdout",
    )
    add_type(parser, "A message or a service (e.g. 'std_msgs/msg/String')")


def main(args: Namespace) -> int:
    name = given_name(args.type)
    text = header_of(name)
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


def header_of(name: str) -> str:
    """The text of the header of a message or a service. Raises CommandError for another definition."""
    from bus_cli.interface.c_header import UnsupportedType

    kind = name.split("/")[1]
    if kind not in ("msg", "srv"):
        raise CommandError(f"{name} is no message and no service; `bus interface c` writes headers of these")
    try:
        return _of_message(name) if kind == "msg" else _of_service(name)
    except UnsupportedType as error:
        raise CommandError(str(error)) from None


def _of_message(name: str) -> str:
    from bus.schema import MessageSchema
    from bus.types.classes import message_class
    from bus_cli.interface.c_header import Described, header

    schema = MessageSchema.of(message_class(name))
    return header(schema.description, Described(name, schema.type_hash, schema.encoded))


def _of_service(name: str) -> str:
    from bus.types.classes import service_class
    from bus.types.service import ServiceSupport
    from bus_cli.interface.c_header import Described, service_header

    support = ServiceSupport(service_class(name))
    requests, replies = support.requests, support.replies(b"")
    return service_header(
        name,
        (support.request.schema, support.response.schema),
        (
            Described(requests.name, requests.hash, requests.description),
            Described(replies.name, replies.hash, replies.description),
        ),
    )
