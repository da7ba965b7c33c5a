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
from functools import partial
from pathlib import Path
from time import monotonic_ns
from typing import Any

from bus.base.time_namespace import monotonic_offset_ns
from bus.base.version import RELEASE
from bus.errors import ConfigurationError
from bus.process.address import socket_path
from bus.process.logfile import log_path
from bus.process.start_errors import check_descriptors
from bus.process.terminal import ends_with_terminal, has_terminal
from busd.config.access import find_doubts
from busd.config.file import Config, load
from busd.config.reload import Reloader
from busd.core.access import Access
from busd.core.broker import Broker
from busd.process.logs import LOG_FORMATS, LOG_LEVELS, set_up
from busd.process.restart import CHECK, command_line, find_fault, hand_over
from busd.process.sd_notify import ALIVE, READY, STOPPING, notify, reloading, status, watchdog_s
from busd.server.credentials import lives
from busd.server.listener import AlreadyRunning, Listener, open_listener
from busd.server.server import Server

EXIT_FAULT = 1
EXIT_ALREADY_RUNNING = 3

_ENDING = (signal.SIGINT, signal.SIGTERM)
_HANDLED = (*_ENDING, signal.SIGHUP)
_THRESHOLDS = 700, 10, 100
"""Python's own, except the last: a full collection can take 10 ms, and nothing in busd leaves a cycle."""
_TURNS = 4
"""After so many turns, the event loop has handled all signals that came before they were blocked."""

_DESCRIPTION = """\
The message bus for the processes of one machine: routes messages between the publishers and
subscriptions of programs that `import bus`.
"""

_EPILOG = """\
socket path, in order of precedence:
  --socket PATH, $BUSD_SOCKET, $XDG_RUNTIME_DIR/busd/<domain>.sock, /tmp/busd-<uid>/<domain>.sock

You need not start busd: the first program that opens a node starts one in the background, which exits once
it has been idle for a while. Start it yourself to see its log or to give it a configuration.

signals: SIGTERM or Ctrl-C stops busd in order (a second one at once), SIGHUP reads FILE again
exit status: 0 stopped, 1 could not start, 3 another busd is running there
see also: bus daemon status, bus doctor, docs/configuration.md, docs/operation.md
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the daemon; returns its exit status."""
    options = _parser().parse_args(arguments)
    # Signals wait while no event loop handles them: so the socket is removed whenever one comes.
    signal.pthread_sigmask(signal.SIG_BLOCK, _HANDLED)
    try:
        path = socket_path(options.socket, options.domain)
        config = load(options.config) if options.config else Config()
        run = _loop_runner()
        if options.check:
            for doubt in find_doubts(config.access, path):
                print(f"busd: {doubt}", file=sys.stderr)
            return 0
        _allow_descriptors()
        check_descriptors()
        signal.signal(signal.SIGTTOU, signal.SIG_IGN)  # else writing to a terminal may stop it
        _set_up_log(options, config, path)
        with open_listener(path, rights=config.socket) as listener:
            _warn_of_doubts(config, listener)
            command = command_line(arguments)
            if run(_serve(listener, config, options, partial(find_fault, command))):
                logging.shutdown()  # lines that wait to be written would go with this program
                hand_over(command, listener.bequeath())
        return 0
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
    parser.add_argument("--version", action="version", version=f"busd {RELEASE}")
    parser.add_argument("--socket", type=Path, metavar="PATH", help="listen on this UNIX socket")
    parser.add_argument(
        "--domain",
        type=int,
        metavar="N",
        help="a separate bus on this machine (default: $BUSD_DOMAIN, else 0)",
    )
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="limits, topic and access rules (busd.toml)"
    )
    parser.add_argument(
        "--log-level", choices=LOG_LEVELS, help="lowest level of log lines on stderr (default: info)"
    )
    parser.add_argument(
        "--log-format",
        choices=LOG_FORMATS,
        help="log format: plain text, or one JSON object a line (default: text)",
    )
    parser.add_argument(
        "--idle-exit", type=_seconds, metavar="S", help="stop after S seconds without a connection"
    )
    parser.add_argument(CHECK, action="store_true", help="check FILE for errors, then exit")
    return parser


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0
    if not 0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds above 0")
    return value


def _set_up_log(options: argparse.Namespace, config: Config, socket: Path) -> None:
    level, form = options.log_level or config.log_level, options.log_format or config.log_format
    set_up(level, form, log_path(socket))


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


async def _serve(
    listener: Listener,
    config: Config,
    options: argparse.Namespace,
    find_fault: Callable[[], Coroutine[Any, Any, str]],
) -> bool:
    """Serve until the end; returns whether another busd is to take over."""
    gc.freeze()  # imported modules stay: no collection need look at them
    gc.set_threshold(*_THRESHOLDS)
    own = os.getuid()
    access = Access(own, config.access)
    broker = Broker(
        config.limits,
        config.topics,
        access,
        uid=own,
        pid=os.getpid(),
        clock_ns=monotonic_offset_ns(),
        lives=lives,
    )
    server = Server(
        listener,
        broker,
        idle_s=options.idle_exit,
        find_fault=find_fault,
        reload=lambda: reload(is_asked=True),
    )
    loop = asyncio.get_running_loop()
    for number in _ENDING:
        loop.add_signal_handler(number, server.stop_now, number.name)

    def apply(config: Config) -> None:
        listener.let_in(config.socket)  # first, because it may raise
        _set_up_log(options, config, listener.path)
        server.reconfigure(config.limits, config.topics, Access(own, config.access))

    def reload(*, is_asked: bool = False) -> str:
        before = reloader.config
        changes = reloader.reload(is_asked=is_asked)
        if reloader.config is not before or not is_asked:
            _warn_of_doubts(reloader.config, listener)
        return changes

    reloader = Reloader(options.config, config, apply)
    loop.add_signal_handler(signal.SIGHUP, _on_hangup, server, reload, ends_with_terminal())
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _HANDLED)
    log = logging.getLogger("busd")
    if not notify(f"{READY}\n{status(f'listening on {listener.path}')}"):
        log.info("listening on %s (pid %d)", listener.path, os.getpid())
    if interval_s := watchdog_s():
        _show_life(loop, interval_s / 2)
    reason = await server.stopped
    signal.pthread_sigmask(signal.SIG_BLOCK, _HANDLED)
    for _ in range(_TURNS):
        await asyncio.sleep(0)
    notify(reloading(monotonic_ns()) if server.is_restarting else STOPPING)
    log.info("%s: %s", "restarting" if server.is_restarting else "stopped", reason)
    return server.is_restarting


def _warn_of_doubts(config: Config, listener: Listener) -> None:
    for doubt in find_doubts(config.access, listener.path):
        logging.getLogger("busd").warning("%s", doubt)


def _on_hangup(server: Server, reload: Callable[[], str], does_end: bool) -> None:
    if does_end and not has_terminal():
        server.stop_now("its terminal was closed")
    else:
        with suppress(ConfigurationError):  # which is logged
            reload()


def _show_life(loop: asyncio.AbstractEventLoop, interval_s: float) -> None:
    notify(ALIVE)
    loop.call_later(interval_s, _show_life, loop, interval_s)
