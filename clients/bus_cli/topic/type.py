"""`bus topic type`."""

from argparse import ArgumentParser, Namespace

from bus.names import is_hidden_topic
from bus_cli.completion import completed_by, topics
from bus_cli.output import complain, show
from bus_cli.query import full_topic_name, get_graph


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
    if not types:
        from bus_cli.suggestions import near_topic

        if near := near_topic(topic, graph):  # else, as in ros2, the status says it
            complain(f"Unknown topic '{args.topic_name}'{near}")
    for name in types:
        show(name, {"topic": topic, "type": name}, as_json=args.json)
    return 0 if types else 1
