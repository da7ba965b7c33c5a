"""`bus topic list`: names of topics."""

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence

from bus.names import is_hidden_topic
from bus_cli.output import print_json, say
from bus_cli.query import graph_to_list

Row = tuple[str, list[str], int, int]
"""Topic, its types, its numbers of publishers and subscriptions."""


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("-t", "--show-types", action="store_true", help="Additionally show the topic type")
    parser.add_argument(
        "-c", "--count-topics", action="store_true", help="Only display the number of topics discovered"
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="List full details about each topic")


def main(args: Namespace) -> int:
    graph = graph_to_list(args)
    rows = [
        (topic, types, len(graph.publishers_of(topic)), len(graph.subscriptions_of(topic)))
        for topic, types in graph.topics().items()
        if args.include_hidden_topics or not is_hidden_topic(topic)
    ]
    if args.json:
        _print_json(rows, count_only=args.count_topics)
    elif args.count_topics:
        say(len(rows))
    elif args.verbose and rows:
        say(_part("Published", "publisher", [(topic, types, count) for topic, types, count, _ in rows]))
        say(_part("Subscribed", "subscriber", [(topic, types, count) for topic, types, _, count in rows]))
    else:
        for topic, types, _, _ in rows:
            say(f"{topic} [{', '.join(types)}]" if args.show_types else topic)
    return 0


def _part(title: str, noun: str, rows: Sequence[tuple[str, list[str], int]]) -> str:
    lines = [
        f" * {topic} [{', '.join(types)}] {count} {noun}{'s' if count > 1 else ''}\n"
        for topic, types, count in rows
        if count
    ]
    return f"{title} topics:\n{''.join(lines)}"


def _print_json(rows: Sequence[Row], *, count_only: bool) -> None:
    if count_only:
        print_json({"count": len(rows)})
        return
    for topic, types, publishers, subscriptions in rows:
        print_json({"topic": topic, "types": types, "publishers": publishers, "subscriptions": subscriptions})
