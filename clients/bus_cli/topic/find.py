"""`bus topic find`: topics of a type."""

from argparse import ArgumentParser, Namespace

from bus.names import is_hidden_topic
from bus_cli.completion import completed_by, types
from bus_cli.query import full_type_name, get_graph, show_found


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("topic_type", help="Name of the type to filter for (e.g. 'std_msgs/msg/String')"),
        types,
    )
    parser.add_argument(
        "-c", "--count-topics", action="store_true", help="Only display the number of topics discovered"
    )


def main(args: Namespace) -> int:
    wanted = full_type_name(args.topic_type)
    graph = get_graph(args)
    found = [
        topic
        for topic, types in graph.topics().items()
        if wanted in types and (args.include_hidden_topics or not is_hidden_topic(topic))
    ]
    return show_found(args, "topic", "msg", wanted, found, only_count=args.count_topics, graph=graph)
