"""`bus topic pub`: publish a message given as YAML once, several times, or for ever."""

import asyncio
from argparse import ArgumentParser, Namespace
from collections.abc import AsyncIterator
from functools import partial
from typing import Any

from bus.node import Node
from bus.publisher import Publisher
from bus.types.support import type_support
from bus_cli.completion import completed_by, topics, types
from bus_cli.documents import load, read_documents
from bus_cli.output import CommandError, print_json, say
from bus_cli.populate import Prototype
from bus_cli.qosargs import add_qos_arguments, given_profile
from bus_cli.render import View
from bus_cli.stream import find_class, open_node, positive, run_stream, unsigned_int

_RATE_HZ = 1.0
_KEEP_ALIVE_S = 0.1
_CLOCK_S = 0.01  # timers of an event loop may be early by the resolution of its clock
_REPEAT_S = 1.0


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("topic_name", help="Name of the topic to publish to (e.g. '/chatter')"), topics
    )
    completed_by(
        parser.add_argument("message_type", help="Type of the message (e.g. 'std_msgs/msg/String')"), types
    )
    parser.add_argument(
        "values",
        nargs="?",
        default="{}",
        help='Values to fill the message with in YAML format (e.g. "data: Hello World"), otherwise the '
        "message will be published with default values; `now` fills a Time, `auto` a Header",
    )
    parser.add_argument(
        "--stdin",
        action="store_true",
        help="Read values from standard input: YAML documents as echo prints them, published as they come",
    )
    parser.add_argument(
        "-r", "--rate", metavar="N", type=positive, help=f"Publishing rate in Hz (default: {_RATE_HZ:g})"
    )
    parser.add_argument(
        "-p",
        "--print",
        metavar="N",
        type=unsigned_int,
        default=1,
        help="Only print every N-th published message (default: 1)",
    )
    group = parser.add_mutually_exclusive_group()
    group.add_argument("-1", "--once", action="store_true", help="Publish one message and exit")
    group.add_argument(
        "-t",
        "--times",
        metavar="N",
        type=unsigned_int,
        default=0,
        help="Publish this number of times and then exit",
    )
    parser.add_argument(
        "-w",
        "--wait-matching-subscriptions",
        metavar="N",
        type=unsigned_int,
        help="Wait until finding the specified number of matching subscriptions (default: 1 with -1/--once "
        "or -t/--times, otherwise 0)",
    )
    parser.add_argument(
        "--max-wait-time-secs",
        metavar="S",
        type=positive,
        help="Give up waiting for subscriptions after S seconds",
    )
    parser.add_argument(
        "--keep-alive",
        metavar="S",
        type=float,
        default=_KEEP_ALIVE_S,
        help=f"Stay this long after the last message (default: {_KEEP_ALIVE_S})",
    )
    parser.add_argument("-n", "--node-name", metavar="NAME", help="Name of the node (default: a hidden one)")
    add_qos_arguments(parser, "publish", "default")


def main(args: Namespace) -> int:
    values = None if args.stdin else load(args.values)
    return run_stream(_publish(args, values))


async def _publish(args: Namespace, values: Any) -> int:
    times = 1 if args.once else args.times
    wanted = args.wait_matching_subscriptions
    if wanted is None:
        wanted = 1 if times else 0
    async with open_node(args, args.node_name) as node:
        topic = node.resolve_topic_name(args.topic_name)
        message_type = await find_class(node, await node.graph(), topic, args.message_type)
        assert message_type is not None
        fixed = None if args.stdin else Prototype(message_type, values)
        publisher = await node.create_publisher(message_type, topic, given_profile(args))
        await _wait_for_subscriptions(publisher, wanted, args)
        if not args.json:
            say("publisher: beginning loop")
        loop = _Loop(args, publisher, times)
        if fixed is not None:
            await loop.repeat(node, fixed)
        else:
            await loop.each(Prototype(message_type, document) async for document in read_documents())
        await publisher.flush()
        await asyncio.sleep(args.keep_alive)
    return 0


async def _wait_for_subscriptions(publisher: Publisher[Any], wanted: int, args: Namespace) -> None:
    loop = asyncio.get_running_loop()
    end_s = None if args.max_wait_time_secs is None else loop.time() + args.max_wait_time_secs
    while (found := publisher.get_subscription_count()) < wanted:
        left_s = _REPEAT_S if end_s is None else end_s - loop.time()
        if left_s < _CLOCK_S:
            raise CommandError(
                f"Timed out waiting for subscribers: Expected {wanted} subscribers "
                f"but only got {found} subscribers"
            )
        if not args.json:
            say(f"Waiting for at least {wanted} matching subscription(s)...")
        try:
            await asyncio.wait_for(publisher.wait_for_subscriptions(wanted), min(_REPEAT_S, left_s))
        except TimeoutError:
            pass


class _Loop:
    """Publishes and prints messages, and counts them."""

    def __init__(self, args: Namespace, publisher: Publisher[Any], times: int) -> None:
        self._args = args
        self._publisher = publisher
        self._times = times
        self._count = 0
        self._done = asyncio.get_running_loop().create_future()

    async def repeat(self, node: Node, prototype: Prototype) -> None:
        """Publish the same message at the rate, starting now."""
        await self._send(prototype)
        if not self._done.done():
            node.create_timer(1 / (self._args.rate or _RATE_HZ), partial(self._send, prototype))
        await self._done

    async def each(self, prototypes: AsyncIterator[Prototype]) -> None:
        """Publish one message after the other: as they arrive, or at the rate if there is one."""
        due_s, loop = 0.0, asyncio.get_running_loop()
        async for prototype in prototypes:
            if self._args.rate:
                await asyncio.sleep(due_s - loop.time())
                due_s = max(due_s, loop.time()) + 1 / self._args.rate
            await self._send(prototype)
            if self._done.done():
                return

    async def _send(self, prototype: Prototype) -> None:
        if self._done.done():
            return
        prototype.stamp()
        self._count += 1
        if self._args.print and self._count % self._args.print == 0:
            self._print(prototype.message)
        await self._publisher.send(prototype.message)
        if self._count == self._times:
            self._done.set_result(None)

    def _print(self, message: Any) -> None:
        if self._args.json:
            schema = type_support(type(message)).schema
            plain = View(octets=True).plain(schema, schema["root"], message)
            print_json({"count": self._count, "message": plain})
        else:
            say(f"publishing #{self._count}: {message!r}\n")
