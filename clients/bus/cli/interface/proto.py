"""`bus interface proto`."""

from argparse import ArgumentParser, Namespace

from bus.cli.interface.show import add_type, given_name
from bus.cli.output import print_json, say


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--no-quotes", action="store_true", help="if true output has no outer quotes.")
    add_type(parser, "Show an interface definition (e.g. 'std_msgs/msg/String')")


def main(args: Namespace) -> int:
    from bus.cli.render import View, to_yaml
    from bus.idl import Message
    from bus.interfaces import find_definition
    from bus.interfacetypes import message_class
    from bus.typesupport import type_support

    name = given_name(args.type)
    definition = find_definition(name)
    # A service or an action: what is sent to it.
    message = definition if isinstance(definition, Message) else definition[1]
    support = type_support(message_class(message.name))
    plain = View().plain(support.schema, support.schema["root"], support.cls())
    if args.json:
        print_json({"type": name, "prototype": plain})
        return 0
    text = to_yaml(plain)
    say(text if args.no_quotes else f'"{text}"')
    return 0
