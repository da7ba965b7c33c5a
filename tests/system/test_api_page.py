"""docs/api.md on a live bus: its examples work, and tab completion shows exactly the names on the page."""

import ast
import asyncio
import inspect
import io
import re
from collections.abc import Iterator
from typing import Any

import bus
from apipage import GROUPS, examples
from apisource import entries
from bus.msg import Message, float64
from bus.msg.sensor_msgs import Image
from bus.msg.std_msgs import String
from bus.srv.example_interfaces import AddTwoInts
from semantics import node

__all__ = ["node"]

PUBLIC = entries()
SCRIPTS = ("run", "connect", "BlockingNode", "BlockingPublisher", "BlockingSubscription")
"""Names with examples that run outside an event loop."""
PIXELS = 640 * 480


class EnoughError(Exception):
    """Ends an example that would run forever."""


driven: list[int] = []


def drive() -> None:
    driven.append(1)
    if len(driven) == 2:
        raise EnoughError


async def main() -> None:
    pass


async def start_work(request: Any, request_id: bus.RequestId) -> None:
    pass


async def around(node: bus.Node) -> dict[str, Any]:
    """Objects that the examples use without defining them."""
    publisher = await node.create_publisher(String, "chatter")
    subscription = await node.create_subscription(String, "chatter", 100)
    images = await node.create_publisher(Image, "images")
    server = await node.create_service(AddTwoInts, "add", lambda request: AddTwoInts.Response())
    client = await node.create_client(AddTwoInts, "add")
    await publisher.wait_for_subscriptions()
    await subscription.wait_for_publishers()
    await client.wait_for_service()
    publisher.publish(String(data="hi"))
    given = {"node": node, "publisher": publisher, "subscription": subscription, "images": images}
    given |= {"server": server, "client": client, "request_id": bus.RequestId(publisher.gid, 1)}
    given |= {"camera": io.BytesIO(bytes(PIXELS)), "text": "hi", "main": main, "drive": drive}
    given |= {"start_work": start_work, "bus": bus, "Message": Message, "float64": float64}
    return given | {"String": String, "Image": Image, "AddTwoInts": AddTwoInts}


def shown() -> Iterator[tuple[str, str]]:
    for path, one in PUBLIC.items():
        for example in examples(one):
            yield path, example
    for title, (intro, _) in GROUPS.items():
        for example in re.findall(r"```python\n(.*?)```", intro, re.DOTALL):
            yield title, example


async def test_examples_work(node: bus.Node) -> None:
    given = await around(node)
    tried = 0
    for path, example in shown():
        driven.clear()
        try:
            if path.partition(".")[0] in SCRIPTS:
                await asyncio.to_thread(in_a_script, path, example, given)
            else:
                await perform(path, example, given)
        except EnoughError:
            pass
        except BaseException as error:
            error.add_note(f"in the example of {path}:\n{example}")
            raise
        tried += 1
    assert tried > 50


async def perform(path: str, example: str, given: dict[str, Any]) -> None:
    waiting = eval(compile(example, path, "exec", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT), {**given})
    if inspect.iscoroutine(waiting):
        await waiting


def in_a_script(path: str, example: str, given: dict[str, Any]) -> None:
    if path == "run":
        exec(example, {**given})
        return
    with bus.connect("another", arguments=[]) as script:
        publisher = script.create_publisher(String, "chatter")
        subscription = script.create_subscription(String, "chatter")
        publisher.publish(String(data="a"))
        exec(example, {**given, "node": script, "publisher": publisher, "subscription": subscription})


async def test_tab_completion_shows_what_the_page_has(node: bus.Node) -> None:
    given = await around(node)
    message, info = await given["subscription"].receive()
    graph = await node.graph(statistics=True)
    rate, timer = node.create_rate(1.0), node.create_timer(1.0, print)
    loan = given["images"].loan(Image(), "data", 1)
    objects = [node, node.get_logger(), info, graph, graph.nodes[0], graph.publishers[0], graph.matches[0]]
    objects += [given[name] for name in ("publisher", "subscription", "server", "client", "request_id")]
    objects += [one.statistics() for one in objects if callable(getattr(one, "statistics", None))]
    objects += [given["publisher"].matches[0], graph.publishers[0].statistics, rate, timer, loan]
    for one in objects:
        path = type(one).__name__
        assert completed(one) == {member.name for member in PUBLIC[path].members}, path
    loan.discard()
    assert message == String(data="hi")


def completed(one: object) -> set[str]:
    """The public names that an interpreter offers after the dot, without names from Python's own classes."""
    of_python = [base for base in type(one).__mro__ if not base.__module__.startswith("bus.")]
    return {name for name in dir(one) if name[0] != "_"} - {name for base in of_python for name in dir(base)}
