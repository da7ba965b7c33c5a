"""The program `busd`: command line, event loop, signals, readiness, exit codes."""

import argparse
import asyncio
import gc
import logging
import os
import resource
import signal
import sys
from collections.abc import Callable, Coroutine, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from bus.address import socket_path
from bus.errors import ConfigurationError
from busd.config import LOG_LEVELS, Config, load
from busd.core.broker import Broker
from busd.listener import AlreadyRunning, Listener, open_listener
from busd.notify import READY, STOPPING, notify, status
from busd.server import Server

EXIT_FAULT = 1
EXIT_ALREADY_RUNNING = 3

_ENDING = (signal.SIGINT, signal.SIGTERM)
_LONGEST_LINE = 1000
_MOST_LINES = 100

_DESCRIPTION = """\
The message bus for the processes of one machine: routes messages between the publishers and
subscriptions of programs that `import bus`.
"""

_EPILOG = """\
where it listens, first that is set:
  --socket PATH, $BUSD_SOCKET, $XDG_RUNTIME_DIR/busd/<domain>.sock, /tmp/busd-<uid>/<domain>.sock

You need not start busd: the first program that opens a node does, in the background, and that busd leaves
when it has been idle for a while. Start it yourself to see its log or to give it a configuration.

exit status: 0 stopped, 1 could not start, 3 another busd is running there
see also: bus daemon status, bus doctor, docs/configuration.md
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the daemon; returns its exit status."""
    options = _parser().parse_args(arguments)
    # They wait while no event loop listens to them, so that the socket is removed whenever they come.
    signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)
    try:
        path = socket_path(options.socket, options.domain)
        _allow_descriptors()
        config = load(options.config) if options.config else Config()
        _set_up_log(options.log_level or config.log_level)
        with open_listener(path) as listener:
            return _loop_runner()(_serve(listener, config, options.idle_exit))
    except AlreadyRunning as error:
        print(f"busd: {error}", file=sys.stderr)
        return EXIT_ALREADY_RUNNING
    except (ConfigurationError, OSError) as error:
        print(f"busd: {error}", file=sys.stderr)
        return EXIT_FAULT


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="busd",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--socket", type=Path, metavar="PATH", help="listen on this UNIX socket")
    parser.add_argument(
        "--domain",
        type=int,
        metavar="N",
        help="a bus of its own on this machine (default: $BUSD_DOMAIN, else 0)",
    )
    parser.add_argument("--config", type=Path, metavar="FILE", help="limits and topic rules (busd.toml)")
    parser.add_argument("--log-level", choices=LOG_LEVELS, help="how much to say on stderr (default: info)")
    parser.add_argument(
        "--idle-exit", type=_seconds, metavar="S", help="stop after S seconds without a connection"
    )
    return parser


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0
    if not 0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds above 0")
    return value


def _set_up_log(level: str) -> None:
    logging.addLevelName(logging.WARNING, "WARN")
    logging.addLevelName(logging.CRITICAL, "FATAL")
    handler = logging.StreamHandler(sys.stderr)
    handler.addFilter(_Bounds())
    logging.basicConfig(
        level=level.upper(),
        handlers=[handler],
        format="[%(levelname)s] [%(created).9f] [%(name)s]: %(message)s",
    )


class _Bounds(logging.Filter):
    """Bounds what peers can make of the log: short printable lines, and not too many in a second.

    Errors always come through, and debug lines are for somebody who wants all of them.
    """

    def __init__(self) -> None:
        super().__init__()
        self._second = 0
        self._lines = 0

    def filter(self, record: logging.LogRecord) -> bool:
        left_out = 0
        if logging.DEBUG < record.levelno < logging.ERROR:
            if int(record.created) != self._second:
                left_out = self._lines - _MOST_LINES
                self._second, self._lines = int(record.created), 0
            self._lines += 1
            if self._lines > _MOST_LINES:
                return False
        text = record.getMessage()[:_LONGEST_LINE]
        if not text.isprintable():
            text = "".join(c if c.isprintable() else "?" for c in text)
        record.msg = f"{text} ({left_out} lines were left out)" if left_out > 0 else text
        record.args = ()
        return True


def _allow_descriptors() -> None:
    """As many as the system lets us have: each publisher that shares memory costs one here."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    with suppress(ValueError, OSError):  # some systems say "no limit" and mean another
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))


def _loop_runner() -> Callable[[Coroutine[Any, Any, int]], int]:
    try:
        import uvloop
    except ImportError:
        return asyncio.run
    return uvloop.run


async def _serve(listener: Listener, config: Config, idle_s: float | None) -> int:
    gc.freeze()  # what was imported stays: no collection need look at it
    broker = Broker(config.limits, config.topics, uid=os.getuid(), pid=os.getpid())
    server = Server(listener, broker, idle_s=idle_s)
    loop = asyncio.get_running_loop()
    for number in _ENDING:
        loop.add_signal_handler(number, server.stop, number.name)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)
    log = logging.getLogger("busd")
    if not notify(f"{READY}\n{status(f'listening on {listener.path}')}"):
        log.info("listening on %s (pid %d)", listener.path, os.getpid())
    reason = await server.stopped
    signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)
    notify(STOPPING)
    log.info("stopped: %s", reason)
    return 0
