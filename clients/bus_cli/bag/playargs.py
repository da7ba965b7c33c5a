"""Shared options of `bus bag play` and `bus bag burst`: the bag, the messages, and the way to play them."""

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from pathlib import Path
from typing import Any

from bus_cli.bag.reading import add_input_argument, add_storage_argument, input_paths, overrides_in
from bus_cli.output import CommandError
from bus_cli.stream import positive, run_stream, unsigned_int

__all__ = ["add_reader_arguments", "nanoseconds", "not_negative", "play", "rate", "seconds"]

_MOST_S = 1e10
_NS_PER_S = 1_000_000_000
_LEVELS = ("debug", "info", "warn", "error", "fatal")


def add_reader_arguments(parser: ArgumentParser) -> None:
    from bus_bag.storage.registry import suffix_list

    parser.add_argument("bag_path", nargs="?", help=f"Bag to play: its folder, or a file {suffix_list()}")
    add_input_argument(parser, is_required=False)
    parser.set_defaults(usage=parser.error)
    add_storage_argument(parser)
    parser.add_argument(
        "--read-ahead-queue-size",
        metavar="N",
        type=unsigned_int,
        default=1000,
        help="Number of messages to read ahead (default: 1000)",
    )
    parser.add_argument("--topics", metavar="TOPIC", nargs="+", default=[], help="Play only these topics")
    parser.add_argument(
        "--services", metavar="SERVICE", nargs="+", default=[], help="Play only the events of these services"
    )
    parser.add_argument(
        "--qos-profile-overrides-path",
        metavar="FILE",
        help="YAML file with QoS profiles that replace the recorded ones, by topic",
    )
    parser.add_argument(
        "--storage-config-file", metavar="FILE", help="ignored: files are read without settings"
    )
    parser.add_argument(
        "-m",
        "--remap",
        metavar="OLD:=NEW",
        nargs="+",
        default=[],
        help="Publish topics under other names: /old:=/new",
    )
    parser.add_argument(
        "--start-offset",
        metavar="S",
        type=not_negative,
        default=0.0,
        help="Start S seconds into the bag, with the latched state of that moment",
    )
    parser.add_argument(
        "--progress-bar-update-rate",
        metavar="HZ",
        type=int,
        default=3,
        help="Updates of the progress line per second, on a terminal; 0: none, -1: one for each message "
        "(default: 3)",
    )
    parser.add_argument(
        "--disable-keyboard-controls",
        action="store_true",
        help="Don't read keyboard controls from the terminal",
    )
    parser.add_argument("--log-level", choices=_LEVELS, help="Which lines are logged (default: info)")
    parser.add_argument(
        "-v", "--verbose", action="store_true", help="Print at the end how late messages were published"
    )


def play(args: Namespace, *, burst: int | None = None, **options: Any) -> int:
    """Play with the arguments and further `options` of PlayOptions; returns the exit code."""
    from bus_bag.play.options import PlayOptions
    from bus_bag.play.program import run
    from bus_bag.play.selection import Selection

    if args.log_level:
        from bus.logger import set_default_level

        set_default_level(args.log_level)
    selection = Selection(
        topics=args.topics,
        services=args.services,
        regex=getattr(args, "regex", ""),
        exclude_topics=getattr(args, "exclude_topics", ()),
        exclude_services=getattr(args, "exclude_services", ()),
        exclude_regex=getattr(args, "exclude_regex", ""),
    )
    given = PlayOptions(
        selection=selection,
        overrides=overrides_in(args.qos_profile_overrides_path),
        remaps=args.remap,
        start_offset=nanoseconds(args.start_offset),
        read_ahead=args.read_ahead_queue_size,
        progress_hz=args.progress_bar_update_rate,
        has_keys=not args.disable_keyboard_controls,
        is_verbose=args.verbose,
        **options,
    )

    paths = _bag_paths(args)

    async def main() -> int:
        await run(paths, given, burst=burst, socket=args.socket, domain=args.domain)
        return 0

    return run_stream(main())


def _bag_paths(args: Namespace) -> list[Path]:
    if args.bag_path is not None and args.input:
        raise CommandError(
            "[ERROR] [ros2bag]: do not mix the [bag_path] positional argument and the -i,--input option; "
            "for multiple input bags, use -i,--input multiple times"
        )
    if args.bag_path is None and not args.input:
        args.usage("give the bag to play, or -i BAG for each of several bags")
    return input_paths(args) if args.input else [Path(args.bag_path)]


def rate(text: str) -> float:
    """For argparse."""
    from bus_bag.play.time_line import TimeLine

    if not TimeLine.is_rate(value := positive(text)):
        raise ArgumentTypeError(f"{text} is not {TimeLine.RATES}")
    return value


def nanoseconds(seconds: float) -> int:
    return round(seconds * _NS_PER_S)


def seconds(text: str) -> float:
    """For argparse."""
    try:
        value = float(text)
    except ValueError:
        value = _MOST_S
    if not -_MOST_S < value < _MOST_S:
        raise ArgumentTypeError(f"{text} is not a number of seconds")
    return value


def not_negative(text: str) -> float:
    """For argparse."""
    if (value := seconds(text)) < 0:
        raise ArgumentTypeError(f"{text} is not a number of seconds from 0")
    return value
