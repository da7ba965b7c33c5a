"""Options of `bus bench`, and the plan made from them. Only reads the command line."""

import re
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from typing import Final

from bus.qos import History, QoSProfile
from bus.wire.layout import MAX_MESSAGE_BYTES
from bus_cli.bench.payload import BYTES, HEAD
from bus_cli.bench.plan import Plan
from bus_cli.completion import completed_by, types
from bus_cli.qosargs import add_qos_arguments, given_profile

__all__ = ["add_bench_arguments", "read_plan", "read_sizes"]

_SIZE: Final = 64
_SECONDS: Final = 3.0
_WARM_UP_S: Final = 0.5
_TYPE: Final = "std_msgs/msg/String"
_MOST_PROCESSES: Final = 128
_THOUSANDS: Final = {"": 1, "B": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9}
_POWERS: Final = {"K": 1 << 10, "KIB": 1 << 10, "M": 1 << 20, "MIB": 1 << 20, "G": 1 << 30, "GIB": 1 << 30}
_UNITS: Final = _THOUSANDS | _POWERS
_METHOD: Final = """\
How it is measured: each publisher and subscriber is a separate process. A message has the time right
before it was made, of CLOCK_MONOTONIC, which all processes share; the subscriber's callback compares that
with the clock first. Messages of the warm-up do not count. With a fixed rate, the schedule is fixed too:
a delayed publisher sends all overdue messages at once. The output has the age since a message was sent
and since it was due, so that a delay counts for all messages that it delayed (no coordinated omission).
At full speed there is no schedule; a message is stamped at most once a millisecond, and its age is mostly
the time in queues. Percentiles are measured values (nearest rank). Rates are from the first message
published to the last one taken. Every message is accounted for: delivered, or lost for the reason shown.
Without --qos options all endpoints are reliable and keep all, which loses no message and makes the
publisher wait; if a message is still lost, the exit status is 1."""


def add_bench_arguments(parser: ArgumentParser, *, subscribers: int, rate: float) -> None:
    """Add all options. `rate` is the default pace; 0 is a flood."""
    parser.epilog = _METHOD
    parser.add_argument(
        "--size",
        metavar="SIZES",
        type=read_sizes,
        default=(_SIZE,),
        help=f"size of the text or bytes in a message, as 64, 1KiB, 4M; several by comma (default: {_SIZE})",
    )
    pace = f"{rate:g}" if rate else "as fast as possible"
    parser.add_argument(
        "--rate",
        metavar="HZ",
        type=_rate,
        default=rate,
        help=f"messages a second of each publisher at a fixed rate (default: {pace})",
    )
    length = parser.add_mutually_exclusive_group()
    length.add_argument(
        "--count", metavar="N", type=_count, default=0, help="messages that each publisher publishes"
    )
    length.add_argument(
        "--seconds",
        metavar="S",
        type=_seconds,
        default=_SECONDS,
        help=f"how long publishers publish (default: {_SECONDS:g})",
    )
    parser.add_argument(
        "--warm-up",
        metavar="S",
        type=_warm_up,
        default=_WARM_UP_S,
        help=f"seconds before that, not measured (default: {_WARM_UP_S:g})",
    )
    parser.add_argument(
        "--publishers",
        metavar="N",
        type=_processes,
        default=1,
        help="number of publishers, each a process (default: 1)",
    )
    parser.add_argument(
        "--subscribers",
        metavar="N",
        type=_processes,
        default=subscribers,
        help=f"number of subscribers, each a process that gets all messages (default: {subscribers})",
    )
    parser.add_argument(
        "--route",
        choices=("shm", "socket"),
        help="how messages travel: by shared memory or through busd (default: as for all programs)",
    )
    kind = parser.add_argument(
        "--type",
        dest="message_type",
        metavar="TYPE",
        default=_TYPE,
        help=f"type of the messages, or '{BYTES}'; --size goes to its first field of bytes, else of text, "
        f"else of numbers (default: {_TYPE})",
    )
    completed_by(kind, types)
    parser.add_argument("--plot", action="store_true", help="also print a histogram of the ages")
    add_qos_arguments(parser, "measure", "default")


def read_plan(args: Namespace, verb: str, paces: tuple[float, ...]) -> Plan:
    """Make the plan from the options. Raises ConfigurationError for a QoS out of range."""
    options = vars(args).items()
    is_given = any(
        name.startswith("qos_") and name != "qos_preset" and value is not None for name, value in options
    )
    return Plan(
        verb=verb,
        type_name=args.message_type,
        sizes=args.size,
        paces=paces,
        count=args.count,
        seconds=args.seconds,
        warm_up_s=args.warm_up,
        publishers=args.publishers,
        subscribers=args.subscribers,
        route=args.route,
        qos=given_profile(args) if is_given else QoSProfile(history=History.KEEP_ALL),
    )


def read_sizes(text: str) -> tuple[int, ...]:
    """Read sizes such as `64,1KiB,4M`, for argparse; returns bytes. KB is 1,000; K and KiB are 1,024."""
    return tuple(_size(part.strip()) for part in text.split(","))


def _size(text: str) -> int:
    found = re.fullmatch(r"(\d{1,12})\s*([A-Za-z]*)", text)
    factor = _UNITS.get(found[2].upper()) if found else None
    if found is None or factor is None:
        raise ArgumentTypeError(f"'{text}' is not a size; write it as 64, 1KiB, 4MiB or 2MB")
    size = int(found[1]) * factor
    if size < HEAD:
        raise ArgumentTypeError(f"{text} is too small: the stamps need {HEAD} B")
    if size > MAX_MESSAGE_BYTES:
        raise ArgumentTypeError(f"{text} is too large: no message may have more than {MAX_MESSAGE_BYTES} B")
    return size


def _number(text: str, least: float, most: float, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not least <= value <= most:
        raise ArgumentTypeError(f"'{text}' is not {what} from {least:,g} to {most:,.15g}")
    return value


def _rate(text: str) -> float:
    return _number(text, 0.01, 1e6, "a number of messages a second")


def _seconds(text: str) -> float:
    return _number(text, 0.01, 86400, "a number of seconds")


def _warm_up(text: str) -> float:
    return _number(text, 0, 3600, "a number of seconds")


def _count(text: str) -> int:
    return _whole(text, 10**9)


def _processes(text: str) -> int:
    return _whole(text, _MOST_PROCESSES)


def _whole(text: str, most: int) -> int:
    if not (text.isascii() and text.isdigit() and len(text) < 12 and 1 <= int(text) <= most):
        raise ArgumentTypeError(f"'{text}' is not a whole number from 1 to {most}")
    return int(text)
