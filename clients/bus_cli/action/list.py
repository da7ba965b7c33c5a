"""`bus action list`: names of actions."""

from argparse import ArgumentParser, Namespace

from bus_actions.graph import action_clients_of, action_servers_of, actions_of
from bus_cli.output import print_json, say, show
from bus_cli.query import graph_to_list


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("-t", "--show-types", action="store_true", help="Additionally show the action type")
    parser.add_argument(
        "-c", "--count-actions", action="store_true", help="Only display the number of actions discovered"
    )


def main(args: Namespace) -> int:
    graph = graph_to_list(args)
    rows = actions_of((*graph.publishers, *graph.subscriptions))
    if args.count_actions:
        show(len(rows), {"count": len(rows)}, as_json=args.json)
        return 0
    for action, types in rows.items():
        if args.json:
            servers, clients = len(action_servers_of(graph, action)), len(action_clients_of(graph, action))
            print_json({"action": action, "types": types, "servers": servers, "clients": clients})
        else:
            say(f"{action} [{', '.join(types)}]" if args.show_types else action)
    return 0
