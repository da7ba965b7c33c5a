"""`bus lifecycle set`: let a lifecycle node make a transition."""

from argparse import ArgumentParser, Namespace

from bus_cli.completion import completed_by
from bus_cli.lifecycle.remote import add_node_argument, call, find_node, transitions
from bus_cli.output import CommandError, complain, print_json, say
from bus_cli.stream import open_node, run_stream


def add_arguments(parser: ArgumentParser) -> None:
    add_node_argument(parser)
    completed_by(
        parser.add_argument("transition", help="The lifecycle transition: its label or its id"), transitions
    )


def main(args: Namespace) -> int:
    return run_stream(_set(args, find_node(args)))


async def _set(args: Namespace, name: str) -> int:
    async with open_node(args) as node:
        servers = (await node.graph()).servers_of(f"{name}/change_state")
        if len(servers) > 1:  # all nodes would make the transition, but only the first answer would count
            where = ", ".join(f"{one.node.full_name} (pid {one.node.pid})" for one in servers)
            raise CommandError(
                f"'{name}/change_state' is served {len(servers)} times, by {where}: rename one"
            )
        answer = await call(node, name, "get_available_transitions", "GetAvailableTransitions")
        possible = [one.transition for one in answer.available_transitions]
        wanted = [one for one in possible if args.transition == one.label]
        wanted += [one for one in possible if args.transition == str(one.id)]
        if not wanted:
            there = "".join(f"\n- {one.label} [{one.id}]" for one in possible)
            raise CommandError(f"Unknown transition requested, available ones are:{there}")
        done = await call(node, name, "change_state", "ChangeState", timeout_s=None, transition=wanted[0])
    if args.json:
        print_json({"node": name, "transition": wanted[0].label, "success": done.success})
    elif done.success:
        say("Transitioning successful")
    else:
        complain("Transitioning failed")
    return 0 if done.success else 1
