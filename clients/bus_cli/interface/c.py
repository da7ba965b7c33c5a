"""`bus interface c`: a C header for a message or a service, and the folder of the C client."""

from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bus_cli.interface.show import add_type, given_name
from bus_cli.output import CommandError, say

if TYPE_CHECKING:
    from bus_cli.interface.c_fields import Language
    from bus_cli.interface.c_header import Constants


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FOLDER",
        help="Write FOLDER/TYPE.h (C++: TYPE.hpp) and print its path. Default: the header on stdout",
    )
    parser.add_argument(
        "--path",
        action="store_true",
        help="Print the folder of the client instead: include/, in C also the sources and a Makefile",
    )
    add_type(parser, "A message or a service (e.g. 'std_msgs/msg/String')", is_optional=True)


def main(args: Namespace) -> int:
    return write(args, "c", ".h")


def write(args: Namespace, language: str, suffix: str) -> int:
    """Print or write the header, or print the folder of the client."""
    if args.path:
        if args.type is not None or args.output is not None:
            raise CommandError("--path has neither a type nor --output")
        say(str(client_folder(language)))
        return 0
    if args.type is None:
        raise CommandError("name a message or a service, such as std_msgs/msg/String, or use --path")
    name = given_name(args.type)
    text = header_of(name, language)
    if args.output is None:
        say(text.rstrip("\n"))
        return 0
    path = args.output / f"{name}{suffix}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    except OSError as error:
        raise CommandError(f"can't write {path}: {error.strerror}") from None
    say(str(path))
    return 0


def client_folder(language: str, installed: Path = Path(__file__).parents[2]) -> Path:
    """The folder of the client for `c` or `cpp`. Raises CommandError if this installation has none."""
    for folder in (installed / "bus_c" / language, installed / language):  # from a wheel; in a checkout
        if (folder / "include" / "busd").is_dir():
            return folder
    raise CommandError(
        f"this installation of busd has no client for {language}: {installed / 'bus_c'} is missing"
    )


def header_of(name: str, language: str = "c") -> str:
    """The text of the header of a message or a service. Raises CommandError for another definition."""
    from bus_cli.interface.c_fields import UnsupportedType
    from bus_cli.interface.c_header import LANGUAGES

    kind = name.split("/")[1]
    if kind not in ("msg", "srv"):
        raise CommandError(
            f"{name} is no message and no service; `bus interface {language}` writes headers of these"
        )
    try:
        return (_of_message if kind == "msg" else _of_service)(name, LANGUAGES[language])
    except UnsupportedType as error:
        raise CommandError(str(error)) from None


def _of_message(name: str, language: "Language") -> str:
    from bus.schema import MessageSchema
    from bus.types.classes import message_class
    from bus_cli.interface.c_header import Described, header

    schema = MessageSchema.of(message_class(name))
    described = Described(name, schema.type_hash, schema.encoded)
    return header(schema.description, described, _constants_of(schema.description), language)


def _of_service(name: str, language: "Language") -> str:
    from bus.types.classes import service_class
    from bus.types.service import ServiceSupport
    from bus_cli.interface.c_header import Described, service_header

    support = ServiceSupport(service_class(name))
    requests, replies = support.requests, support.replies(b"")
    bodies = (support.request.schema, support.response.schema)
    return service_header(
        name,
        bodies,
        (
            Described(requests.name, requests.hash, requests.description),
            Described(replies.name, replies.hash, replies.description),
        ),
        _constants_of(*bodies),
        language,
    )


def _constants_of(*descriptions: Mapping[str, Any]) -> "Constants":
    """The constants of all types in these descriptions."""
    from bus.types.definitions import find_message

    names = {name for description in descriptions for name in description["types"]}
    return {
        name: [(one.name, one.type.base, one.value) for one in find_message(name).constants] for name in names
    }
