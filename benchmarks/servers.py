"""The servers of rivals: finds them, and starts each for one measurement in its folder.

The address of a server is in the environment of processes started later (BENCH_SERVER). No data is kept.
"""

import json
import signal
import socket
from collections.abc import Callable
from time import monotonic, sleep

from benchmarks.harness import START_S, Child, Failure, Group
from benchmarks.machine import path_of

_NATS = """
max_payload: 8MB
max_pending: 1GB
write_deadline: "60s"
"""
_REDIS = (
    *("--port", "0", "--save", "", "--appendonly", "no", "--loglevel", "warning"),
    *("--client-output-buffer-limit", "pubsub", "0", "0", "0"),
)
_POOLS = ((1 << 10, 2000), ((64 << 10) + 256, 600), ((1 << 20) + 256, 64), ((4 << 20) + 256, 16))
"""Sizes and numbers of iceoryx's chunks: each size has those of the benchmark and the chunk's header."""
_ROUDI_SOCKET = "/tmp/roudi"
_LOOK_S = 0.005


def serve_nats(group: Group, module: str) -> list[Child]:
    """Start a nats-server on a free port of loopback. Raises Failure if it does not start."""
    config = group.folder / "nats.conf"
    config.write_text(_NATS)
    where = ("--addr", "127.0.0.1", "--port", "-1", "--ports_file_dir", str(group.folder))
    program = path_of("nats-server")
    child = group.start("nats-server", program, "--config", str(config), *where, stop_signal=signal.SIGTERM)
    ports = group.folder / f"nats-server_{child.pid}.ports"
    group.environ["BENCH_SERVER"] = _await(child, lambda: str(json.loads(ports.read_bytes())["nats"][0]))
    return [child]


def serve_redis(group: Group, module: str) -> list[Child]:
    """Start a redis-server on a UNIX socket, without data on disk. Raises Failure if it does not start."""
    path = str(group.folder / "redis.sock")
    arguments = (*_REDIS, "--unixsocket", path, "--dir", str(group.folder))
    child = group.start("redis-server", path_of("redis-server"), *arguments, stop_signal=signal.SIGTERM)

    def ask() -> str:
        with socket.socket(socket.AF_UNIX) as client:
            client.settimeout(START_S)
            client.connect(path)
            client.sendall(b"PING\r\n")
            if not client.recv(100).startswith(b"+PONG"):
                raise OSError("not ready")
        return f"unix://{path}"

    group.environ["BENCH_SERVER"] = _await(child, ask)
    return [child]


def serve_roudi(group: Group, module: str) -> list[Child]:
    """Start iceoryx's daemon. Raises Failure if it does not start: there can be only one on a machine."""
    config = group.folder / "roudi.toml"
    pools = "".join(f"[[segment.mempool]]\nsize = {size}\ncount = {count}\n" for size, count in _POOLS)
    config.write_text(f"[general]\nversion = 1\n[[segment]]\n{pools}")
    options = ("--config-file", str(config), "--monitoring-mode", "off")
    child = group.start("iox-roudi", path_of("iox-roudi"), *options, stop_signal=signal.SIGTERM)

    def ask() -> str:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as client:
            client.connect(_ROUDI_SOCKET)
        return _ROUDI_SOCKET

    _await(child, ask)
    return [child]


def _await(child: Child, look: Callable[[], str]) -> str:
    """Call `look` until it does not raise, and return its result: these servers don't report when they are
    ready."""
    deadline = monotonic() + START_S
    while True:
        try:
            return look()
        except (OSError, ValueError):
            child.is_running()
            if monotonic() > deadline:
                raise Failure(f"{child.name} is not ready after {START_S:g} s") from None
            sleep(_LOOK_S)
