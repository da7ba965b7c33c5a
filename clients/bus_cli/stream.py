"""Shared code of the verbs that keep running: a hidden node, types from the bus, their end by signals."""

import asyncio
import os
import select
import signal
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Coroutine, Iterable
from contextlib import suppress
from typing import Any, TypeVar

import msgspec

from bus.errors import ConfigurationError
from bus.graph import Graph, GraphEndpoint
from bus.node import Node
from bus.process.start_errors import check_descriptors
from bus.process.termination import Terminated
from bus.runner import loop_factory
from bus.schema import MessageSchema
from bus.types.diff import difference
from bus.types.support import find_type
from bus_cli.output import CommandError, complain, reader
from bus_cli.query import full_type_name

__all__ = [
    "add_window_argument",
    "find_class",
    "for_ever",
    "not_published",
    "open_node",
    "positive",
    "positive_int",
    "run_stream",
    "unsigned_int",
    "warn_if_unknown",
]

T = TypeVar("T")

_ENDING: dict[int, type[KeyboardInterrupt]] = {signal.SIGINT: KeyboardInterrupt, signal.SIGTERM: Terminated}


def run_stream(main: Coroutine[Any, Any, T], *, only_prints: bool = False) -> T:
    """Run a verb on an event loop; returns its result, mostly an exit code.

    Raises KeyboardInterrupt or Terminated if a signal ended it, after its cleanup. If it `only_prints`,
    raises BrokenPipeError as soon as the reader of its output is gone.
    """
    try:
        check_descriptors()
    except BaseException:
        main.close()
        raise
    ends: list[type[BaseException]] = []
    try:
        with asyncio.Runner(loop_factory=loop_factory()) as runner:
            return runner.run(_until_end(main, reader() if only_prints else None, ends))
    except asyncio.CancelledError:
        if not ends:
            raise
        raise ends[0] from None


async def _until_end(
    main: Coroutine[Any, Any, T], watch: select.epoll | None, ends: list[type[BaseException]]
) -> T:
    loop, task = asyncio.get_running_loop(), asyncio.current_task()
    assert task is not None

    def end(why: type[BaseException]) -> None:
        ends.append(why)
        task.cancel()

    def lose_reader() -> None:
        assert watch is not None
        loop.remove_reader(watch.fileno())
        end(BrokenPipeError)

    for number, why in _ENDING.items():
        loop.add_signal_handler(number, end, why)
    if watch is not None:
        loop.add_reader(watch.fileno(), lose_reader)
    try:
        return await main
    finally:
        for number in _ENDING:
            loop.remove_signal_handler(number)
        if watch is not None:
            loop.remove_reader(watch.fileno())
            watch.close()


def open_node(args: Namespace, name: str | None = None) -> Node:
    """A node of the tool; without a `name` it is hidden."""
    return Node(
        name or f"_bus_cli_{os.getpid()}", arguments=(), socket=args.socket, domain=args.domain, rosout=False
    )


async def find_class(
    node: Node, graph: Graph, topic: str, type_name: str | None = None
) -> type[msgspec.Struct] | None:
    """The class for `topic`'s messages, made from the schema on the bus, or a ready-made one.

    Without `type_name`, it is the class of the topic's type; None if no endpoint has the topic. Raises
    CommandError if the topic has several types, or if the type `type_name` is unknown.
    """
    endpoints = (*graph.publishers, *graph.subscriptions)
    everywhere = [(one.topic, (one.type_name, one.type_hash)) for one in endpoints]
    here = list(dict.fromkeys(kind for where, kind in everywhere if where == topic))
    if type_name is None:
        if len(here) > 1:
            types = ", ".join(dict.fromkeys(name for name, _ in here))
            first = {(one.type_name, one.type_hash): one for one in reversed(endpoints) if one.topic == topic}
            why = await _difference(node, *(first[kind] for kind in here[:2]))
            text = f"Cannot echo topic '{topic}', as it contains more than one type: [{types}]"
            raise CommandError(f"{text}{why}")
        schema = await _first_schema(node, here)
        return None if schema is None else schema.to_class()
    name = full_type_name(type_name)
    kinds = dict.fromkeys(kind for kind in (*here, *(kind for _, kind in everywhere)) if kind[0] == name)
    if (schema := await _first_schema(node, kinds)) is not None:
        return schema.to_class()
    if (ready_made := find_type(name)) is not None:
        return ready_made
    from bus_cli.suggestions import near_type

    raise CommandError(f"The passed message type is invalid{near_type(name, 'msg', graph)}")


async def _first_schema(node: Node, kinds: Iterable[tuple[str, str]]) -> MessageSchema | None:
    for kind in kinds:
        with suppress(ConfigurationError):  # its last endpoint has gone since the request for the graph
            return await node.get_schema(*kind)
    return None


async def _difference(node: Node, one: GraphEndpoint, other: GraphEndpoint) -> str:
    """The difference between two types of one name, as the end of a sentence; "" if the names differ."""
    if one.type_name != other.type_name:
        return ""
    try:
        ours, theirs = [await node.get_schema(end.type_name, end.type_hash) for end in (one, other)]
        found = difference(ours.encoded, theirs.encoded, (one.node.full_name, other.node.full_name))
    except ConfigurationError:
        found = None
    found = found or f"their definitions differ ({one.type_hash} and {other.type_hash})"
    return f"; {one.node.full_name} and {other.node.full_name} both call it {one.type_name}, but {found}"


def not_published(topic: str, graph: Graph) -> None:
    """Print a warning that the topic is not published, with a similar name."""
    from bus_cli.suggestions import near_topic

    complain(f"WARNING: topic [{topic}] does not appear to be published yet{near_topic(topic, graph)}")


async def warn_if_unknown(node: Node, topic: str) -> None:
    """Print a warning if no endpoint has the topic yet: a subscription without a class waits for one."""
    graph = await node.graph()
    if topic not in graph.topics():
        not_published(topic, graph)


async def for_ever() -> int:
    """Wait until a signal ends the verb, or until a callback fails."""
    code: int = await asyncio.get_running_loop().create_future()
    return code


def add_window_argument(parser: ArgumentParser, size: int, meaning: str) -> None:
    """Add `--window`: the number of messages over which a verb measures."""
    parser.add_argument(
        "-w", "--window", type=positive_int, default=size, help=f"{meaning} (default: {size})"
    )


def positive_int(text: str) -> int:
    """Read a positive integer, for argparse."""
    if not (text.isascii() and text.isdigit() and 0 < len(text) < 10 and int(text)):
        raise ArgumentTypeError("value must be a positive integer")
    return int(text)


def unsigned_int(text: str) -> int:
    """Read a non-negative integer, for argparse."""
    if not (text.isascii() and text.isdigit() and len(text) < 19):
        raise ArgumentTypeError("value must be non-negative integer")
    return int(text)


def positive(text: str) -> float:
    """Read a positive number, for argparse."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < 1e9:
        raise ArgumentTypeError("value must be a positive number")
    return value
