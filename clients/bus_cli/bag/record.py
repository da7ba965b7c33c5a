"""`bus bag record`: record topics into a bag, as `ros2 bag record` does."""

from argparse import ArgumentParser, Namespace
from pathlib import Path
from time import localtime, strftime

from bus.names import validate_full_topic_name
from bus.node import Node
from bus_cli.bag.compression import add_compression_arguments, preset_of
from bus_cli.bag.reading import overrides_in
from bus_cli.completion import completed_by, topics, types
from bus_cli.output import CommandError, complain
from bus_cli.query import full_type_name
from bus_cli.stream import unsigned_int

_NAME = "rosbag2_recorder"
_CACHE = 100 << 20


def add_arguments(parser: ArgumentParser) -> None:
    from bus_bag.storage.registry import DEFAULT, writable_storages

    storages = [one.identifier for one in writable_storages()]
    completed_by(parser.add_argument("names", nargs="*", metavar="TOPIC", help="topics to record"), topics)
    parser.add_argument(
        "-o", "--output", metavar="FOLDER", help="the bag to create (default: a folder named after the time)"
    )
    parser.add_argument(
        "-s",
        "--storage",
        choices=storages,
        default=DEFAULT.identifier,
        help=f"storage identifier to be used ({', '.join(storages)})",
    )
    group = parser.add_argument_group("what to record")
    completed_by(
        group.add_argument("--topics", nargs="+", default=[], metavar="TOPIC", help="these topics"), topics
    )
    group.add_argument(
        "--services", nargs="+", default=[], metavar="SERVICE", help="events of these services"
    )
    completed_by(
        group.add_argument(
            "--topic-types", nargs="+", default=[], metavar="TYPE", help="topics of these types"
        ),
        types,
    )
    group.add_argument("-a", "--all", action="store_true", help="all topics and events of services")
    group.add_argument("--all-topics", action="store_true", help="all topics")
    group.add_argument("--all-services", action="store_true", help="events of all services")
    group.add_argument(
        "-e", "--regex", default="", help="topics and services with a match of REGEX in their name"
    )
    group.add_argument(
        "--exclude-regex",
        default="",
        metavar="REGEX",
        help="exclude topics and services with a match of REGEX in their name",
    )
    group.add_argument(
        "--exclude-topics", nargs="+", default=[], metavar="TOPIC", help="exclude these topics"
    )
    group.add_argument(
        "--exclude-topic-types", nargs="+", default=[], metavar="TYPE", help="exclude topics of these types"
    )
    group.add_argument(
        "--exclude-services", nargs="+", default=[], metavar="SERVICE", help="exclude these services"
    )
    group.add_argument(
        "--include-unpublished-topics", action="store_true", help="also topics without a publisher"
    )
    group.add_argument(
        "--ignore-leaf-topics", action="store_true", help="exclude topics without a subscription"
    )
    group.add_argument(
        "--no-discovery", action="store_true", help="only topics that exist when the recording starts"
    )
    group.add_argument(
        "-p", "--polling-interval", type=int, metavar="MS", help="ignored: busd reports topics at once"
    )
    group.add_argument("--qos-profile-overrides-path", metavar="FILE", help="QoS profiles by topic, in YAML")
    group = parser.add_argument_group("how to write")
    group.add_argument(
        "-b",
        "--max-bag-size",
        type=unsigned_int,
        default=0,
        metavar="BYTES",
        help="start a new file at this size; 0: never",
    )
    group.add_argument(
        "-d",
        "--max-bag-duration",
        type=unsigned_int,
        default=0,
        metavar="S",
        help="start a new file after S seconds; 0: never",
    )
    group.add_argument(
        "--max-bag-files", type=unsigned_int, default=0, metavar="N", help="keep the newest N files; 0: all"
    )
    group.add_argument(
        "--max-cache-size",
        type=unsigned_int,
        default=_CACHE,
        metavar="BYTES",
        help=f"bytes kept while the disk is busy (default: {_CACHE}); 0: none",
    )
    group.add_argument(
        "--storage-preset-profile",
        choices=list(dict.fromkeys(preset for one in writable_storages() for preset in one.presets)),
        default="none",
        help="how the file is chunked and compressed",
    )
    group.add_argument(
        "-f",
        "--serialization-format",
        choices=("cdr",),
        default="cdr",
        help="the format of messages in the file (default: cdr)",
    )
    group.add_argument(
        "--storage-config-file", metavar="FILE", help="refused: --storage-preset-profile replaces it"
    )
    group.add_argument("--custom-data", nargs="*", metavar="KEY=VALUE", help="stored in the bag's metadata")
    group.add_argument(
        "--snapshot-mode",
        action="store_true",
        help="keep the newest messages in memory, write them when ~/snapshot is called",
    )
    add_compression_arguments(parser)
    group = parser.add_argument_group("how to run")
    group.add_argument("--start-paused", action="store_true", help="wait for SPACE, or ~/resume")
    group.add_argument("--disable-keyboard-controls", action="store_true", help="read no keys")
    group.add_argument(
        "--node-name", default=_NAME, metavar="NAME", help=f"the recorder's node (default: {_NAME})"
    )
    group.add_argument(
        "--progress-bar-update-rate",
        type=float,
        default=3.0,
        metavar="HZ",
        help="updates of the status line per second, on a terminal (default: 3); 0: none",
    )
    group.add_argument(
        "--log-level",
        choices=["debug", "info", "warn", "error", "fatal"],
        default="info",
        help="logging level",
    )


def main(args: Namespace) -> int:
    """Record until Ctrl-C; returns 1 if the disk is full."""
    args.topics = [*args.names, *args.topics]
    args.use_sim_time = getattr(args, "use_sim_time", False)
    folder = Path(args.output or strftime("rosbag2_%Y_%m_%d-%H_%M_%S", localtime()))
    _check(args, folder)
    from bus_bag.record.choice import Wanted
    from bus_bag.record.options import RecordOptions
    from bus_bag.record.program import run

    options = RecordOptions(
        folder=folder,
        wanted=Wanted(
            topics=_names(args.topics),
            services=_names(args.services),
            topic_types=_types(args.topic_types),
            regex=args.regex,
            all_topics=args.all or args.all_topics,
            all_services=args.all or args.all_services,
            exclude_topics=_names(args.exclude_topics),
            exclude_services=_names(args.exclude_services),
            exclude_topic_types=_types(args.exclude_topic_types),
            exclude_regex=args.exclude_regex,
            include_hidden_topics=args.include_hidden_topics,
            include_unpublished_topics=args.include_unpublished_topics,
            ignore_leaf_topics=args.ignore_leaf_topics,
        ),
        overrides=overrides_in(args.qos_profile_overrides_path),
        has_discovery=not args.no_discovery,
        max_bag_size=args.max_bag_size,
        max_bag_duration=args.max_bag_duration,
        max_bag_files=args.max_bag_files,
        max_cache_size=args.max_cache_size,
        storage=args.storage,
        preset=preset_of(args),
        is_paused=args.start_paused,
        is_simulated=args.use_sim_time,
        is_snapshot=args.snapshot_mode,
        custom_data=dict(map(_pair, args.custom_data or ())),
        node_name=args.node_name,
        progress_hz=args.progress_bar_update_rate,
        has_keys=not args.disable_keyboard_controls,
    )
    arguments = ["--ros-args", "--log-level", args.log_level]
    if args.use_sim_time:
        arguments += ["-p", "use_sim_time:=true"]
    return run(
        options,
        lambda: Node(args.node_name, arguments=arguments, socket=args.socket, domain=args.domain),
    )


def _check(args: Namespace, folder: Path) -> None:
    """Raise the errors of ros2 bag for options that contradict each other."""
    has_all = args.all or args.all_topics
    if not (has_all or args.all_services or args.services or args.topics or args.topic_types or args.regex):
        raise _error(
            "Need to specify at least one option out of --all, --all-topics, --all-services, --services, "
            "--topics, --topic-types or --regex"
        )
    if args.exclude_regex and not (has_all or args.topic_types or args.all_services or args.regex):
        raise _error(
            "--exclude-regex argument requires either --all, --all-topics, --topic-types, --all-services or "
            "--regex"
        )
    if args.exclude_topics and not (has_all or args.topic_types or args.regex):
        raise _error(
            "--exclude-topics argument requires either --all, --all-topics, --topic-types or --regex"
        )
    if args.exclude_topic_types and not (has_all or args.topic_types or args.regex):
        raise _error("--exclude-topic-types argument requires either --all, --all-topics or --regex")
    if args.exclude_services and not (args.all or args.all_services or args.regex):
        raise _error("--exclude-services argument requires either --all, --all-services or --regex")
    if (args.all or args.all_services) and args.services:
        _warn("--all or --all-services will override --services")
    if has_all and args.topics:
        _warn("--all or --all-topics will override --topics")
    if (has_all or args.all_services) and args.regex:
        _warn("--all, --all-topics or --all-services will override --regex")
    if folder.is_dir():
        raise _error(f"Output folder '{folder}' already exists.")
    if args.use_sim_time and args.no_discovery:
        raise _error(
            "--use-sim-time and --no-discovery both set, but are incompatible settings. The /clock topic "
            "needs to be discovered to record with sim time."
        )
    if args.storage_config_file:
        raise _error("--storage-config-file is not available; --storage-preset-profile has the settings")
    if args.snapshot_mode and not args.max_cache_size:
        raise _error("In snapshot mode, max_cache_size must be larger than 0")


def _error(text: str) -> CommandError:
    return CommandError(f"[ERROR] [ros2bag]: {text}")


def _warn(text: str) -> None:
    complain(f"[WARN] [ros2bag]: {text}")


def _names(names: list[str]) -> frozenset[str]:
    from bus_bag.topic_names import absolute_names

    found = absolute_names(names)
    for name in found:
        validate_full_topic_name(name)
    return found


def _types(names: list[str]) -> frozenset[str]:
    return frozenset(map(full_type_name, names))


def _pair(text: str) -> tuple[str, str]:
    key, is_pair, value = text.partition("=")
    if not (key and is_pair):
        raise _error(f"--custom-data takes KEY=VALUE, not '{text}'")
    return key, value
