"""Monitoring: the rate of each topic, the age of its messages, and losses with nodes and reasons.

On a terminal it shows a table that stays in place, otherwise a line for each topic every second. It also
publishes the figures as Health. Arguments are names of topics; default: all.
"""

import sys
from collections import deque
from shutil import get_terminal_size

import bus
from bus.logger import Severity
from bus.msg.rcl_interfaces import Log
from bus.process.address import socket_path
from common import HEALTH_TOPIC, TOPICS, Health, TopicHealth
from meter import Meter, lost_on

_IS_TERMINAL = sys.stdout.isatty()
_PERIOD_S = 0.5 if _IS_TERMINAL else 1.0
_LOG_LINES = 6
_CLEAR, _HOME, _REST_OF_LINE, _REST_OF_SCREEN = "\x1b[2J", "\x1b[H", "\x1b[K", "\x1b[J"
_HEADING = "topic  (Hz, ms)    due   sent    got     age     max   stamp  lost"


def row(health: TopicHealth) -> str:
    """A line of the table: rates in Hz, ages in ms."""
    sent, got = health.published / health.window_s, health.received / health.window_s
    ages_s = (health.age_s, health.age_max_s, health.stamp_age_s)
    ages = "".join("       -" if age_s is None else f"{age_s * 1e3:8.2f}" for age_s in ages_s)
    lost = ", ".join(f"{who} {count}" for who, count in health.lost.items()) or "-"
    return f"{health.topic:17} {health.nominal_hz:4.0f} {sent:6.1f} {got:6.1f}{ages}  {lost}"


def screen(health: Health, graph: bus.Graph, log: deque[str]) -> str:
    """The whole screen, drawn over the last one."""
    layers = "  ".join(sorted(f"{node.name} {node.pid}" for node in graph.nodes))
    lines = [
        f"export BUSD_SOCKET={socket_path()}",
        f"processes: {layers}",
        "",
        _HEADING,
        *(row(one) for one in health.topics),
        "",
        *log,
    ]
    width = get_terminal_size().columns
    return _HOME + "".join(f"{line[:width]}{_REST_OF_LINE}\n" for line in lines) + _REST_OF_SCREEN


async def main() -> None:
    log: deque[str] = deque(maxlen=_LOG_LINES)

    def remember(entry: Log) -> None:
        if entry.level >= Severity.WARN:
            log.append(f"[{Severity(entry.level).name}] [{entry.name}]: {entry.msg}")

    async with bus.Node("monitoring") as node:
        reports = await node.create_publisher(Health, HEALTH_TOPIC, 10)
        await node.create_subscription(Log, "/rosout", bus.qos.rosout_default, remember)
        meters = [Meter(topic) for topic in TOPICS if topic.name in sys.argv[1:] or not sys.argv[1:]]
        for meter in meters:
            topic = meter.topic
            await node.create_subscription(topic.type, topic.name, topic.qos, meter.count)

        async def report() -> None:
            try:
                graph = await node.graph(statistics=True)
            except bus.ConnectionClosed:
                return  # busd restarts
            health = Health([meter.report(lost_on(graph, meter.topic.name)) for meter in meters])
            reports.publish(health)
            if _IS_TERMINAL:
                print(screen(health, graph, log), end="", flush=True)
            else:
                print(*map(row, health.topics), sep="\n", flush=True)

        print(_CLEAR if _IS_TERMINAL else f"export BUSD_SOCKET={socket_path()}\n{_HEADING}", flush=True)
        node.create_timer(_PERIOD_S, report)
        await node.spin()


if __name__ == "__main__":
    bus.run(main())
