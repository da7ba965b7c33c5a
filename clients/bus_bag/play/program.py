"""`bus bag play` and `bus bag burst`: connects a bag, a node, its player and a terminal."""

import asyncio
import sys
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, closing, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from bus.base.counted import counted
from bus.base.keys import Keys
from bus.errors import BusError
from bus.logger import Logger
from bus.node import Node
from bus.publisher import Publisher
from bus.qos import QoSProfile, Reliability
from bus.types.classes import message_class
from bus_bag.play import gaps
from bus_bag.play.keys import CURSOR, LETTERS, Key
from bus_bag.play.options import PlayOptions
from bus_bag.play.player import Player, Span
from bus_bag.play.read_ahead import ReadAheadQueue
from bus_bag.play.requests import ServiceRequests
from bus_bag.play.services import serve
from bus_bag.play.topics import Topics
from bus_bag.storage import JoinedBags, Problem, open_bags
from bus_bag.terminal.keyboard import Keyboard
from bus_bag.terminal.status_line import StatusLine

__all__ = ["Replay", "replay", "run"]

NAME = "rosbag2_player"
_NS_PER_S = 1_000_000_000
_CLOCK = "/clock"
_CLOCK_QOS = QoSProfile(1, reliability=Reliability.BEST_EFFORT)
_SWITCH_S = 0.0005
"""Interval after which the reading thread gives way to the publishing one. Python's own 5 ms make messages
late."""
_NO_KEYS = "stdin is not a terminal device. Keyboard handling disabled."
_PAUSED = (
    "Paused, and no keys are read. To go on: bus service call {node}/resume rosbag2_interfaces/srv/Resume"
)
_RATE_STEP = 0.1


async def run(
    paths: Sequence[Path],
    options: PlayOptions,
    *,
    burst: int | None = None,
    socket: str | None = None,
    domain: int | None = None,
) -> None:
    """Play the bags at `paths` as one to the end, or until it is stopped.

    `burst`: number of messages to publish at once, before everything else (0: all), for a replay that begins
    paused. Raises BagError if one is no valid bag, or if the options choose no topic of them;
    CommandLineError for invalid remappings. Cancellation ends the replay, and restores the terminal.
    """
    with open_bags(paths) as bags:
        async with replay(bags, options, socket=socket, domain=domain) as now:
            playing = asyncio.create_task(now.player.play())
            try:
                if burst is not None:
                    await now.player.burst(burst)
                if now.player.is_paused and not _reads_keys(options):
                    now.logger.info(_PAUSED.format(node=now.node.full_name))
                await playing
            finally:
                playing.cancel()


class Replay(NamedTuple):
    """A replay that is ready to play."""

    node: Node
    player: Player
    topics: frozenset[str]
    """Names of the played topics."""
    logger: Logger


@asynccontextmanager
async def replay(
    bags: JoinedBags, options: PlayOptions, *, socket: str | None = None, domain: int | None = None
) -> AsyncIterator[Replay]:
    """Make a player with its node, publishers, services and keys; `play` is the caller's.

    At the end of the block the messages have been sent, and the terminal is as before. Raises BagError if
    the options choose no topic; CommandLineError for invalid remappings.
    """
    arguments = ["--ros-args", *(word for rule in options.remaps for word in ("--remap", rule))]
    options.selection.check(bags.topics)
    async with Node(NAME, arguments=arguments, socket=socket, domain=domain) as node:
        logger = node.get_logger()
        logger.info(f"Set rate to {options.rate:g}")
        told = set[Problem]()
        _report_problems(bags, logger, told)
        topics = Topics(bags, options, logger)
        publishers = await topics.publish_on(node)
        clock = await _clock(node, options)
        span = _span(bags, options)
        await _report_gaps(bags, topics.names, options, span, logger)
        with _switching(), _reading_ahead(bags, topics, options) as queue, closing(StatusLine()) as line:
            async with Player(queue, publishers, span, options, logger, clock) as player:
                async with _controls(node, player, options, logger, clock, line):
                    yield Replay(node, player, topics.names, logger)
                _report_problems(bags, logger, told)
                topics.report_undecodable()
                if options.acknowledged_within is not None:
                    await _wait_for_all(publishers, options.acknowledged_within, logger)
                if options.is_verbose:
                    count = counted(player.lateness.count, "message")
                    logger.info(f"Lateness: {player.lateness} ({count})")


def _report_problems(bags: JoinedBags, logger: Logger, told: set[Problem]) -> None:
    """Report the problems found so far, each once."""
    for problem in bags.problems:
        if problem not in told:
            told.add(problem)
            logger.warning(str(problem))


async def _report_gaps(
    bags: JoinedBags, topics: frozenset[str], options: PlayOptions, span: Span, logger: Logger
) -> None:
    """Report long times without a message; with `skipped_gap`, the times that are skipped."""
    least = gaps.LONG_NS if options.skipped_gap is None else options.skipped_gap
    found = await asyncio.to_thread(bags.gaps, least, topics, options.order)
    report = logger.warning if options.skipped_gap is None else logger.info
    found = gaps.gaps_in(found, span)
    for line in gaps.lines(found, span, options.skipped_gap, is_in_page=options.stays_at_end):
        report(line)


def _span(bags: JoinedBags, options: PlayOptions) -> Span:
    first = bags.starting_time
    start = first + options.start_offset
    until = -1
    if options.duration is not None:
        until = start + options.duration if options.duration else 0
    if options.until is not None:
        until = max(until, options.until)
    return Span(start, first + bags.duration, start <= first, until)


@contextmanager
def _switching() -> Iterator[None]:
    before = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


@contextmanager
def _reading_ahead(bags: JoinedBags, topics: Topics, options: PlayOptions) -> Iterator[ReadAheadQueue]:
    queue = ReadAheadQueue(
        bags,
        topics.names,
        topics.depths,
        topics.decode,
        order=options.order,
        size=options.read_ahead,
        look_back=options.look_back,
    )
    try:
        yield queue
    finally:
        queue.close()


async def _clock(node: Node, options: PlayOptions) -> Callable[[int], None] | None:
    """A function that publishes a time of the bag; None without the option for it."""
    if not options.has_clock:
        return None
    message_type: Any = message_class("rosgraph_msgs/msg/Clock")
    time_type: Any = message_class("builtin_interfaces/msg/Time")
    publisher = await node.create_publisher(message_type, _CLOCK, _CLOCK_QOS)

    def publish(bag_ns: int) -> None:
        seconds, nanoseconds = divmod(bag_ns, _NS_PER_S)
        publisher.publish(message_type(clock=time_type(sec=seconds, nanosec=nanoseconds)))

    return publish


@asynccontextmanager
async def _controls(
    node: Node,
    player: Player,
    options: PlayOptions,
    logger: Logger,
    clock: Callable[[int], None] | None,
    line: StatusLine,
) -> AsyncIterator[None]:
    """Start services, keys, the clock's timer, and the line of progress."""
    await serve(node, player)
    async with AsyncExitStack() as stack:
        if _reads_keys(options):
            _listen(stack, player, logger)
        elif options.has_keys:
            print(_NO_KEYS, file=sys.stderr, flush=True)
        if clock is not None and options.clock_hz:
            publish = clock
            # With a large rate the time of the bag soon exceeds its end, and then the range of a clock.
            node.create_timer(1 / options.clock_hz, lambda: publish(player.shown_time))
        if line.is_shown and options.progress_hz:

            def show() -> None:
                line.show(str(player.progress))

            if options.progress_hz < 0:
                player.on_message = show
            else:
                node.create_timer(1 / options.progress_hz, show)
            stack.callback(show)
        yield


def _reads_keys(options: PlayOptions) -> bool:
    return options.has_keys and Keyboard.is_there()


def _listen(stack: AsyncExitStack, player: Player, logger: Logger) -> None:
    keys, steps = Keys(LETTERS, CURSOR), set[asyncio.Task[bool]]()
    go_on: list[Callable[[], None]] = []

    def press(key: Key) -> None:
        if key is Key.SPACE:
            player.toggle_paused()
        elif key is Key.CURSOR_RIGHT:
            task = asyncio.create_task(player.play_next())
            steps.add(task)
            task.add_done_callback(steps.discard)
        else:
            # Round to tenths, because binary fractions are not exact.
            step = _RATE_STEP if key is Key.CURSOR_UP else -_RATE_STEP
            player.set_rate(round(player.rate + step, 6))

    def read(data: bytes) -> None:
        for key in keys.feed(data):
            press(key)

    logger.info("Adding keyboard callbacks.")
    for key in Key:
        logger.info(f"Press {key.name} for {key.value}")
    keyboard = Keyboard(read, lambda: go_on.append(player.hold()), lambda: go_on.pop()() if go_on else None)
    stack.callback(keyboard.close)


async def _wait_for_all(
    publishers: Mapping[str, Publisher[Any] | ServiceRequests], within_ms: int, logger: Logger
) -> None:
    for topic, publisher in publishers.items():
        try:
            async with asyncio.timeout(within_ms / 1000 if within_ms else None):
                await publisher.flush()
        except TimeoutError:
            logger.error(
                f"Timed out while waiting for all published messages to be acknowledged for topic {topic}"
            )
        except BusError as error:
            logger.error(
                "Exception occurred while waiting for all published messages to be acknowledged for topic "
                f"{topic} : {error}"
            )
