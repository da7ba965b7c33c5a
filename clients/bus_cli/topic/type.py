"""`bus topic type`: the type of a topic."""

from argparse import ArgumentParser, Namespace

from bus.names import is_hidden_topic
from bus_cli.completion import completed_by, topics
from bus_cli.query import full_topic_name, get_graph
from bus_cli.type_verb import show_types


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("topic_name", help="Name of the topic to get type (e.g. '/chatter')"), topics
    )


def main(args: Namespace) -> int:
    topic = full_topic_name(args.topic_name)
    if is_hidden_topic(topic) and not args.include_hidden_topics:
        return 1
    graph = get_graph(args)
    types = graph.topics().get(topic, [])
    return show_types("topic", topic, types, graph, args)
