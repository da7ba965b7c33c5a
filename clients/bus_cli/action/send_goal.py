"""`bus action send_goal`: a goal given as YAML, its feedback and its result. Ctrl-C cancels the goal."""

import asyncio
from argparse import ArgumentParser, Namespace
from typing import Any

from bus.types.support import type_support
from bus_actions.client import ActionClient, ClientGoal
from bus_actions.errors import GoalAborted, GoalCanceled, GoalRejected
from bus_actions.graph import action_servers_of
from bus_cli.action.definitions import action_types, actions, find_action_type, full_action_type
from bus_cli.completion import completed_by
from bus_cli.documents import add_values_arguments, given_value
from bus_cli.output import complain, print_json, say
from bus_cli.populate import Prototype
from bus_cli.query import full_topic_name
from bus_cli.render import View, to_yaml
from bus_cli.stream import open_node, run_stream


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("action_name", help="Name of the ROS action (e.g. '/fibonacci')"), actions
    )
    completed_by(
        parser.add_argument(
            "action_type", help="Type of the ROS action (e.g. 'example_interfaces/action/Fibonacci')"
        ),
        action_types,
    )
    add_values_arguments(
        parser,
        "goal",
        "Goal request values in YAML format (e.g. '{order: 10}'), otherwise default values",
        stdin_help="Read values from standard input",
    )
    parser.add_argument("-f", "--feedback", action="store_true", help="Echo feedback messages for the goal")


def main(args: Namespace) -> int:
    # Before anything else, report mistakes in the command line itself.
    name, values = full_action_type(args.action_type), given_value(args)
    action = full_topic_name(args.action_name)
    return run_stream(_send(args, action, name, values))


async def _send(args: Namespace, action: str, name: str, values: Any) -> int:
    async with open_node(args) as node:
        graph = await node.graph()
        definition = await find_action_type(node, graph, action, name)
        prototype = Prototype(definition.Goal, values)
        async with ActionClient(node, definition, action) as client:
            if not args.json:
                say("Waiting for an action server to become available...")
            # A new client may not be ready although its server is up, so ask the graph, too.
            if not (client.server_is_ready() or action_servers_of(graph, action)):
                from bus_cli.suggestions import near_action

                if near := near_action(action, graph):
                    complain(f"no server for '{action}'{near}")
            await client.wait_for_server()
            prototype.stamp()
            if not args.json:
                say(f"Sending goal:\n     {_yaml(prototype.message)}")
            try:
                goal = await client.send_goal(prototype.message)
            except GoalRejected:
                _show(args, "Goal was rejected.", {"accepted": False})
                return 1
            _show(
                args,
                f"Goal accepted with ID: {goal.id.hex()}\n",
                {"accepted": True, "goal_id": goal.id.hex()},
            )
            try:
                return await _follow(args, goal)
            except asyncio.CancelledError:
                await _cancel(args, goal)
                raise


async def _follow(args: Namespace, goal: ClientGoal) -> int:
    """Print feedback and result of a goal; returns 0 if the goal succeeds."""
    async for feedback in goal:
        if args.feedback:
            _show(args, f"Feedback:\n    {_yaml(feedback)}", {"feedback": _plain(feedback)})
    try:
        result = await goal.result()
    except (GoalAborted, GoalCanceled) as end:
        result = end.result
    status = goal.status.name
    _show(
        args,
        f"Result:\n    {_yaml(result)}\nGoal finished with status: {status}",
        {"result": _plain(result), "status": status},
    )
    return 0 if status == "SUCCEEDED" else 1


async def _cancel(args: Namespace, goal: ClientGoal) -> None:
    if goal.is_done:
        return
    if not args.json:
        say("Canceling goal...")
    is_canceled = await goal.cancel()
    if not is_canceled:
        complain("Failed to cancel goal")
    else:
        _show(args, "Goal canceled.", {"canceled": True})


def _show(args: Namespace, text: str, record: dict[str, Any]) -> None:
    if args.json:
        print_json(record)
    else:
        say(text)


def _plain(message: Any, *, octets: bool = True) -> Any:
    schema = type_support(type(message)).schema
    return View(octets=octets).plain(schema, schema["root"], message)


def _yaml(message: Any) -> str:
    return to_yaml(_plain(message, octets=False))
