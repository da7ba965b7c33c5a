"""`bus bag info`: a summary of a bag."""

from argparse import ArgumentParser, Namespace
from typing import Any

from bus_cli.bag.reading import add_bag_argument, opened
from bus_cli.output import print_json, say


def add_arguments(parser: ArgumentParser) -> None:
    add_bag_argument(parser)
    parser.add_argument("-t", "--topic-name", action="store_true", help="Only display topic names.")
    parser.add_argument(
        "-v",
        "--verbose",
        action="store_true",
        help="Read all messages, for the size of each topic and the calls of services",
    )
    parser.add_argument(
        "--sort",
        default="name",
        choices=("name", "type", "count"),
        help="Sort topics by name, type or number of messages",
    )


def main(args: Namespace) -> int:
    from bus_bag.info import describe, find_losses, topic_names

    with opened(args) as reader:
        if args.json:
            from msgspec.structs import asdict

            from bus_bag.metadata import as_map

            record: dict[str, Any] = as_map(reader.metadata)
            problems = [{"path": one.path, "offset": one.offset, "text": one.text} for one in reader.problems]
            lost = {topic: asdict(one) for topic, one in find_losses(reader).items()}
            print_json({**record, "losses": lost, "is_cut": reader.is_cut, "problems": problems})
        elif args.topic_name:
            for name in topic_names(reader.metadata, args.sort):
                say(name)
        else:
            say(describe(reader, verbose=args.verbose, sort=args.sort), end="")
    return 0
