"""`bus interface proto`: an example message as YAML."""

from argparse import ArgumentParser, Namespace

from bus_cli.interface.show import add_type, given_name
from bus_cli.output import print_json, say


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--no-quotes", action="store_true", help="if true output has no outer quotes.")
    add_type(parser, "Show an interface definition (e.g. 'std_msgs/msg/String')")


def main(args: Namespace) -> int:
    from bus.types.classes import message_class
    from bus.types.definitions import find_definition
    from bus.types.idl import Message
    from bus.types.support import type_support
    from bus_cli.render import View, to_yaml

    name = given_name(args.type)
    definition = find_definition(name)
    # For a service or an action, show the message that is sent to it.
    message = definition if isinstance(definition, Message) else definition[1]
    support = type_support(message_class(message.name))
    plain = View().plain(support.schema, support.schema["root"], support.cls())
    if args.json:
        print_json({"type": name, "prototype": plain})
        return 0
    text = to_yaml(plain)
    say(text if args.no_quotes else f'"{text}"')
    return 0
