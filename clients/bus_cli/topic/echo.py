"""`bus topic echo`: messages as text, as they come, and on stderr why none come."""

import asyncio
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from typing import Any

from msgspec.structs import replace

from bus.events import MessageLost, SubscriptionEvents
from bus.subscription import MessageInfo
from bus.types.support import type_support
from bus_cli.completion import completed_by, topics, types
from bus_cli.fields import FieldPath
from bus_cli.output import CommandError, complain, dropped_text, print_json, say
from bus_cli.qosargs import add_qos_arguments, choose_profile
from bus_cli.render import TooManyValuesError, to_csv, to_text, to_yaml
from bus_cli.silence import Silence
from bus_cli.stream import (
    find_class,
    not_published,
    open_node,
    positive,
    run_stream,
)
from bus_cli.viewargs import MOST_VALUES, add_view_arguments, view_of

_INFO = (
    "source_timestamp",
    "received_timestamp",
    "publication_sequence_number",
    "reception_sequence_number",
)
_CLEAR = "\033[2J\033[H"


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("topic_name", help="Name of the topic to listen to (e.g. '/chatter')"), topics
    )
    completed_by(
        parser.add_argument(
            "message_type",
            nargs="?",
            help="Type of the message (e.g. 'std_msgs/msg/String'); default: the topic's",
        ),
        types,
    )
    add_qos_arguments(parser, "subscribe", "sensor_data")
    add_view_arguments(parser)
    parser.add_argument(
        "--field",
        action="append",
        metavar="PATH",
        help="Echo a selected field of a message, such as pose.pose.position or ranges[0]; may be repeated",
    )
    parser.add_argument("--no-lost-messages", action="store_true", help="Don't report when a message is lost")
    parser.add_argument("--raw", action="store_true", help="Echo the raw binary representation")
    parser.add_argument(
        "--filter",
        metavar="EXPR",
        help="print only messages for which EXPR is true; m is the message: \"m.data != ''\"",
    )
    parser.add_argument("--once", action="store_true", help="Print the first message received and then exit")
    parser.add_argument("--timeout", metavar="N", type=positive, help="Exit after N seconds")
    parser.add_argument(
        "-i", "--include-message-info", action="store_true", help="Shows the associated message info"
    )
    parser.add_argument(
        "-c", "--clear", "--clear-screen", action="store_true", help="Clear the screen before each message"
    )
    parser.add_argument("-n", "--node-name", metavar="NAME", help="Name of the node (default: a hidden one)")


def main(args: Namespace) -> int:
    return run_stream(_echo(args), only_prints=True)


async def _echo(args: Namespace) -> int:
    if args.raw and (args.field or args.filter or args.csv):
        raise CommandError("--raw prints encoded messages: leave out --field, --filter and --csv")
    passes = None
    if args.filter:
        from bus_cli.filter import compile_filter  # imports Python's parser

        passes = compile_filter(args.filter)
    async with open_node(args, args.node_name) as node:
        topic = node.resolve_topic_name(args.topic_name)
        graph = await node.graph()
        message_type = await find_class(node, graph, topic, args.message_type)
        if message_type is None:
            not_published(topic, graph)
            raise CommandError("Could not determine the type for the passed topic")
        profile = choose_profile(graph, topic, args)
        write = _raw(args) if args.raw else _writer(args, type_support(message_type).schema)
        done = asyncio.get_running_loop().create_future()
        silence = Silence(node, topic)

        def on_message(message: Any, info: MessageInfo | None = None) -> None:
            if done.done():
                return
            silence.received += 1
            if passes is None or passes(message):
                silence.shown += 1
                try:
                    write(message, info)
                except TooManyValuesError:
                    raise CommandError(
                        f"a message on '{topic}' has more than {MOST_VALUES:,} values to show, even with "
                        "arrays truncated; --field shows a part, --no-arr leaves arrays out, "
                        "--full-length shows all"
                    ) from None
                if args.once:
                    done.set_result(None)

        events = SubscriptionEvents(message_lost=None if args.no_lost_messages else _lost_notice(args))

        def on_message_with_info(message: Any, info: MessageInfo) -> None:
            on_message(message, info)

        subscription = await node.create_subscription(
            message_type,
            topic,
            profile,
            on_message_with_info if args.include_message_info else on_message,
            events=events,
            raw=args.raw,
        )
        watching = asyncio.create_task(silence.watch(subscription))
        try:
            await asyncio.wait_for(done, args.timeout)
        except TimeoutError:
            if args.once:
                raise CommandError(f"no message on '{topic}' within {args.timeout:g} s") from None
        finally:
            watching.cancel()
    return 0


def _writer(args: Namespace, schema: dict[str, Any]) -> Callable[[Any, MessageInfo | None], None]:
    """A function that writes a message in the format of the options, with its info if there is one."""
    paths = [FieldPath(text, schema) for text in args.field or ()]
    view = view_of(args)
    budget = view.budget
    # As in ros2, a text that was asked for by itself is not cut.
    whole = replace(view, truncate_length=args.truncate_length)
    clear = _CLEAR if args.clear and sys.stdout.isatty() else ""

    def write(message: Any, info: MessageInfo | None) -> None:
        if budget is not None:
            budget.left = budget.most
        if paths:
            parts = {
                path.text: (whole if path.node == "string" else view).plain(
                    schema, path.node, path.pick(message)
                )
                for path in paths
            }
        else:
            parts = view.plain(schema, schema["root"], message)
        about = None if info is None else _about(info)
        if args.json:
            print_json(parts if about is None else {"info": about, "message": parts})
        elif args.csv:
            sys.stdout.write(clear)
            say(to_csv([*(about or {}).values(), parts]))
        else:
            head = "" if about is None else f"{_info_text(about)}---\n"
            if paths:
                body = "".join(to_text(part, flow_style=args.flow_style) for part in parts.values())
            else:
                body = to_text(parts, flow_style=args.flow_style)
            sys.stdout.write(clear)
            say(f"{head}{body}---")

    return write


def _raw(args: Namespace) -> Callable[[Any, MessageInfo | None], None]:
    """A function that writes a message's encoded bytes, with its info if there is one."""

    def write(payload: memoryview, info: MessageInfo | None) -> None:
        about = None if info is None else _about(info)
        if args.json:
            print_json({**({} if about is None else {"info": about}), "raw": payload.hex()})
        else:
            head = "" if about is None else f"{_info_text(about)}---\n"
            say(f"{head}{bytes(payload)!r}\n---")

    return write


def _about(info: MessageInfo) -> dict[str, int]:
    return {name: getattr(info, name) for name in _INFO}


def _info_text(about: dict[str, int]) -> str:
    return to_yaml(dict(sorted(about.items())))


def _lost_notice(args: Namespace) -> Callable[[MessageLost], None]:
    def notice(lost: MessageLost) -> None:
        text = (
            f"A message was lost!!!\n\ttotal count change:{lost.total_count_change}"
            f"\n\ttotal count: {dropped_text(lost.reasons)}---"
        )
        # What a program reads must stay CSV or JSON.
        if args.csv or args.json:
            complain(text)
        else:
            say(text)

    return notice
