"""`bus bag play`: publish the messages of a bag as they were recorded."""

from argparse import ArgumentParser, Namespace

from bus_cli.bag.playargs import (
    add_reader_arguments,
    nanoseconds,
    not_negative,
    play,
    rate,
    seconds,
)
from bus_cli.stream import positive, unsigned_int

_CLOCK_HZ = 40.0
_SOURCES = ("service_introspection", "client_introspection")
_ORDERS = {"received": "log_time", "sent": "publish_time"}


def add_arguments(parser: ArgumentParser) -> None:
    add_reader_arguments(parser)
    parser.add_argument("-r", "--rate", metavar="R", type=rate, default=1.0, help="Play R times as fast")
    parser.add_argument("-l", "--loop", action="store_true", help="Start again after the end")
    parser.add_argument("-p", "--start-paused", action="store_true", help="Start paused")
    parser.add_argument(
        "-e", "--regex", metavar="REGEX", default="", help="Also play topics and services with such names"
    )
    parser.add_argument("-x", "--exclude-regex", metavar="REGEX", default="", help="Leave these names out")
    parser.add_argument(
        "--exclude-topics", metavar="TOPIC", nargs="+", default=[], help="Leave these topics out"
    )
    parser.add_argument(
        "--exclude-services",
        metavar="SERVICE",
        nargs="+",
        default=[],
        help="Leave the events of these services out",
    )
    parser.add_argument(
        "--publish-service-requests",
        action="store_true",
        help="Send recorded service requests instead of publishing recorded service events",
    )
    parser.add_argument(
        "--service-requests-source",
        choices=_SOURCES,
        default=_SOURCES[0],
        help=f"The events with the requests: of the service or of the client (default: {_SOURCES[0]})",
    )
    parser.add_argument(
        "--disable-loan-message", action="store_true", help="ignored: it makes no difference here"
    )
    group = parser.add_argument_group("simulated time")
    group.add_argument(
        "--clock",
        metavar="HZ",
        type=positive,
        nargs="?",
        const=_CLOCK_HZ,
        default=0.0,
        help="Publish the bag's time to /clock at HZ (without a value: 40); skip the /clock in the bag",
    )
    group = group.add_mutually_exclusive_group()
    group.add_argument(
        "--clock-topics",
        metavar="TOPIC",
        nargs="+",
        help="Publish the time before each message of these topics",
    )
    group.add_argument("--clock-topics-all", action="store_true", help="Publish the time before each message")
    parser.add_argument(
        "-d",
        "--delay",
        metavar="S",
        type=not_negative,
        default=0.0,
        help="Delay before playback starts, and before each loop, in seconds",
    )
    parser.add_argument(
        "--skip-gaps",
        metavar="S",
        type=not_negative,
        help="Skip times of more than S seconds without a message",
    )
    parser.add_argument(
        "--playback-duration",
        metavar="S",
        type=seconds,
        default=-1.0,
        help="Stop after S seconds of the bag's time",
    )
    until = parser.add_mutually_exclusive_group()
    until.add_argument(
        "--playback-until-sec", metavar="S", type=seconds, default=-1.0, help="Stop at this time of the bag"
    )
    until.add_argument(
        "--playback-until-nsec", metavar="NS", type=int, default=-1, help="The same, in nanoseconds"
    )
    parser.add_argument(
        "--wait-for-all-acked",
        metavar="MS",
        type=unsigned_int,
        help="At the end wait up to MS milliseconds for pending messages to be sent (0: no limit)",
    )
    parser.add_argument(
        "--message-order",
        choices=_ORDERS,
        default="received",
        help="Play in the order in which messages were received or sent (default: received)",
    )


def main(args: Namespace) -> int:
    from bus_bag.topic_names import absolute_names

    clock_topics = None
    if args.clock_topics_all:
        clock_topics = frozenset[str]()
    elif args.clock_topics:
        clock_topics = absolute_names(args.clock_topics)
    until = args.playback_until_nsec if args.playback_until_nsec >= 0 else None
    if args.playback_until_sec >= 0:
        until = nanoseconds(args.playback_until_sec)
    return play(
        args,
        rate=args.rate,
        is_looping=args.loop,
        is_paused=args.start_paused,
        duration=nanoseconds(args.playback_duration) if args.playback_duration >= 0 else None,
        until=until,
        delay=nanoseconds(args.delay),
        skipped_gap=None if args.skip_gaps is None else nanoseconds(args.skip_gaps),
        clock_hz=args.clock,
        clock_topics=clock_topics,
        order=_ORDERS[args.message_order],
        requests_source=args.service_requests_source if args.publish_service_requests else "",
        acknowledged_within=args.wait_for_all_acked,
    )
