"""Shared code of `bus topic type`, `bus service type` and `bus action type`."""

from argparse import Namespace
from collections.abc import Sequence

from bus.graph import Graph
from bus_cli.output import complain, show

__all__ = ["show_types"]


def show_types(what: str, name: str, types: Sequence[str], graph: Graph, args: Namespace) -> int:
    """Show the types of a topic, a service or an action (`what`); returns the exit code.

    Without types, it suggests a similar name if there is one; else, as in ros2, only the exit code shows it.
    """
    if not types:
        from bus_cli.suggestions import near_action, near_service, near_topic

        near = {"action": near_action, "service": near_service, "topic": near_topic}[what]
        if hint := near(name, graph):
            complain(f"Unknown {what} '{getattr(args, f'{what}_name')}'{hint}")
    for one in types:
        show(one, {what: name, "type": one}, as_json=args.json)
    return 0 if types else 1
