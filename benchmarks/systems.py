"""Which systems there are, as the parent starts them. What their processes do is in benchmarks.adapters."""

from collections.abc import Callable, Mapping
from importlib.util import find_spec
from types import MappingProxyType
from typing import NamedTuple

import msgspec

from benchmarks.harness import START_S, Child, Failure, Group
from benchmarks.work import Work
from bus import shm

_NOTHING: Mapping[str, str] = MappingProxyType({})


def _serve_nothing(group: Group, module: str) -> list[Child]:
    return []


class System(NamedTuple):
    """A way to get messages from one process to another.

    `serve` starts the processes between the two, whose CPU time is the broker's; `missing` says why the
    system can't be measured here, or nothing. `environ` is added to that of its processes. Where `route` is
    set, a publisher that is matched by another one is a Failure.
    """

    name: str
    module: str
    serve: Callable[[Group, str], list[Child]] = _serve_nothing
    missing: Callable[[], str] = str
    environ: Mapping[str, str] = _NOTHING
    route: str = ""

    def start_servers(self, group: Group) -> list[Child]:
        """Start what stands between the publisher and the subscriber."""
        group.environ["BENCH_FOLDER"] = str(group.folder)
        group.environ.update(self.environ)
        return self.serve(group, self.module)

    def start_role(self, group: Group, role: str, work: msgspec.Struct, *, name: str = "") -> Child:
        """Start the publisher or a subscriber; returns when it is ready."""
        child = group.start_python(name or role, "-m", self.module, role, msgspec.json.encode(work).decode())
        ready = group.expect(child, "ready", within_s=START_S)
        route = ready.get("route", self.route)
        if self.route and route != self.route:
            raise Failure(f"matched by the route {route!r}, not {self.route!r}")
        return child

    def start_pair(self, group: Group, work: Work) -> tuple[Child, Child]:
        """Start the subscriber and then the publisher, which are returned the other way round."""
        subscriber = self.start_role(group, "subscriber", work)
        return self.start_role(group, "publisher", work), subscriber


def _serve_bus(group: Group, module: str) -> list[Child]:
    return [group.start_busd()]


def _serve_relay(group: Group, module: str) -> list[Child]:
    relay = group.start_python("relay", "-m", module, "relay", "{}")
    group.expect(relay, "ready", within_s=START_S)
    return [relay]


def _needs(package: str) -> Callable[[], str]:
    return lambda: "" if find_spec(package) else f"{package} is not installed"


def no_shared_memory() -> str:
    """Why the route by shared memory can't be measured here; empty where it can."""
    return shm.why_not()


_BY_SOCKET = MappingProxyType({"BUS_ROUTE": "socket"})
_STRING, _BYTES, _FAN = (f"benchmarks.adapters.bus_{name}" for name in ("string", "bytes", "fanout"))

BUS = System("busd, shared memory", _STRING, _serve_bus, no_shared_memory, route="shm")
BUS_SOCKET = System("busd, socket", _STRING, _serve_bus, environ=_BY_SOCKET, route="socket")
BUS_BYTES = BUS._replace(module=_BYTES)
BUS_SOCKET_BYTES = BUS_SOCKET._replace(module=_BYTES)
BUS_FAN_OUT = BUS._replace(module=_FAN)
BUS_SOCKET_FAN_OUT = BUS_SOCKET._replace(module=_FAN)
RCLPY = System("rclpy", "benchmarks.adapters.rclpy_string", _serve_bus, no_shared_memory, route="shm")
TWO_HOPS = System("two bare hops", "benchmarks.adapters.floor_two_hops", _serve_relay)
FLOOR = System("barest Python program", "benchmarks.adapters.floor_eventfd")
PIPE = System("multiprocessing.Pipe", "benchmarks.adapters.pipe")
PYZMQ = System("pyzmq", "benchmarks.adapters.zeromq", missing=_needs("zmq"))
ICEORYX = System("iceoryx2", "benchmarks.adapters.iceoryx", missing=_needs("iceoryx2"))
