"""`bus interface list`: names of definitions."""

from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING

from bus_cli.output import say, show

if TYPE_CHECKING:
    from bus.types.definitions import Kind

_TITLES: dict["Kind", str] = {"msg": "Messages", "srv": "Services", "action": "Actions"}


def add_arguments(parser: ArgumentParser) -> None:
    add_kinds(parser, "Print out only the {} types")


def add_kinds(parser: ArgumentParser, text: str) -> None:
    """Add the options that choose kinds; `text` is their help, with a placeholder for the kind."""
    for kind, what in (("msgs", "message"), ("srvs", "service"), ("actions", "action")):
        parser.add_argument(f"-{kind[0]}", f"--only-{kind}", action="store_true", help=text.format(what))


def wanted_kinds(args: Namespace) -> list["Kind"]:
    """The kinds chosen by the options; without options, all kinds."""
    chosen = (args.only_msgs, args.only_srvs, args.only_actions)
    return [kind for kind, is_chosen in zip(_TITLES, chosen, strict=True) if is_chosen or not any(chosen)]


def main(args: Namespace) -> int:
    from bus.types.definitions import names

    for kind in wanted_kinds(args):
        if not args.json:
            say(f"{_TITLES[kind]}:")
        for name in names(kind):
            show(f"    {name}", {"type": name, "kind": kind}, as_json=args.json)
    return 0
