"""The measured systems, as the parent starts them. benchmarks.adapters has the code of their processes."""

import sys
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from types import MappingProxyType
from typing import Literal, NamedTuple

import msgspec

from benchmarks import ros
from benchmarks.adapters import c_program
from benchmarks.harness import START_S, Child, Failure, Group
from benchmarks.machine import path_of
from benchmarks.servers import serve_nats, serve_redis
from benchmarks.work import Work
from bus import shm

Kind = Literal["ours", "floor", "direct", "brokered"]
_NOTHING: Mapping[str, str] = MappingProxyType({})


class Speed(NamedTuple):
    """The approximate speed of a system. A guess, which only chooses the number of messages of a flood."""

    per_s: float = 100_000
    bytes_per_s: float = 500e6

    def messages_in(self, seconds: float, size: int) -> int:
        """The approximate number of messages of `size` bytes in that time: a round number, and never just a
        few."""
        count = seconds / (1 / self.per_s + size / self.bytes_per_s)
        return max(20, int(float(f"{count:.2g}")))


def _serve_nothing(group: Group, module: str) -> list[Child]:
    return []


def _no_place(group: Group, role: str) -> Mapping[str, str]:
    return _NOTHING


class System(NamedTuple):
    """A way to get messages from one process to another.

    - `serve`: starts the processes between both ends. Their CPU time is the broker's.
    - `missing`: returns the reason why the system can't be measured here, or "".
    - `environ`: additional environment of its processes.
    - `route`: if set, a publisher matched by another route is a Failure.
    - `kind`: ours, a limit for comparison, or a rival without or with a process in the middle.
    - `may_lose`: a flood can't be lossless.
    - `fans_out`: to many subscribers, not only from one to one.
    - `takes_by`: the `Work.take_by` that waits for events.
    - `floods`: it can do more than paced messages.
    - `largest`: the largest message, in bytes.
    - `gives_turns`: its publisher has an event loop that needs turns.
    - `publisher`: the module of its publisher, if it is not the subscriber's.
    - `runner`: the command that runs its modules.
    - `publisher_runner`: the one of its publisher, if it is another.
    - `place`: further environment of the publisher, or of a subscriber.
    """

    name: str
    module: str
    serve: Callable[[Group, str], list[Child]] = _serve_nothing
    missing: Callable[[], str] = str
    environ: Mapping[str, str] = _NOTHING
    route: str = ""
    kind: Kind = "direct"
    may_lose: bool = False
    fans_out: bool = True
    takes_by: str = "callback"
    floods: bool = True
    largest: int = 4 << 20
    gives_turns: bool = True
    publisher: str = ""
    runner: tuple[str, ...] = (sys.executable,)
    publisher_runner: tuple[str, ...] = ()
    place: Callable[[Group, str], Mapping[str, str]] = _no_place
    guess: Speed = Speed()

    def start_servers(self, group: Group) -> list[Child]:
        """Start the processes between the publisher and the subscriber."""
        group.environ["BENCH_FOLDER"] = str(group.folder)
        group.environ.update(self.environ)
        return self.serve(group, self.module)

    def start_role(self, group: Group, role: str, work: msgspec.Struct, *, name: str = "") -> Child:
        """Start the publisher or a subscriber; returns when it is ready."""
        return self._expect_ready(group, self.launch(group, role, work, name=name))

    def launch(self, group: Group, role: str, work: msgspec.Struct, *, name: str = "") -> Child:
        """Start the publisher or a subscriber without waiting for it."""
        module = self.publisher or self.module if role == "publisher" else self.module
        arguments = (module, role, msgspec.json.encode(work).decode())
        environ = self.place(group, role)
        runner = (role == "publisher" and self.publisher_runner) or self.runner
        return group.start(name or role, *runner, "-m", *arguments, environ=environ)

    def start_fan(self, group: Group, work: msgspec.Struct, number: int) -> tuple[Child, list[Child]]:
        """Start `number` subscribers in parallel, and then the publisher. Returns the publisher first."""
        names = [f"subscriber_{index}" for index in range(number)]
        subscribers = [self.launch(group, "subscriber", work, name=name) for name in names]
        for child in subscribers:
            self._expect_ready(group, child)
        return self.start_role(group, "publisher", work), subscribers

    def start_pair(self, group: Group, work: Work) -> tuple[Child, Child]:
        """Start the subscriber and then the publisher. Returns the publisher first."""
        subscriber = self.start_role(group, "subscriber", work)
        return self.start_role(group, "publisher", work), subscriber

    def _expect_ready(self, group: Group, child: Child) -> Child:
        ready = group.expect(child, "ready", within_s=START_S)
        route = ready.get("route", self.route)
        if self.route and route != self.route:
            raise Failure(f"matched by the route {route!r}, not {self.route!r}")
        return child


def _serve_bus(group: Group, module: str) -> list[Child]:
    return [group.start_busd()]


def with_busd(system: System, program: str) -> System:
    """`system` with the busd of another checkout; with ours if `program` is empty."""
    return system._replace(serve=lambda group, module: [group.start_busd(program)])


def _serve_relay(group: Group, module: str) -> list[Child]:
    relay = group.start_python("relay", "-m", module, "relay", "{}")
    group.expect(relay, "ready", within_s=START_S)
    return [relay]


def _serve_ros(group: Group, module: str) -> list[Child]:
    group.environ.update(ros.environ(group.folder))
    return []


def _serve_ros_large(group: Group, module: str) -> list[Child]:
    group.environ.update(ros.with_large_segment(group.folder))
    return _serve_ros(group, module)


def _needs(package: str, *, server: str = "") -> Callable[[], str]:
    def missing() -> str:
        if not find_spec(package):
            return f"{package} is not installed"
        return f"{server} is not on PATH" if server and not path_of(server) else ""

    return missing


def no_shared_memory() -> str:
    """The reason why the shared memory route can't be measured here; empty if it can."""
    return shm.why_not()


def no_c_program(name: str = "bare") -> str:
    """The reason why a program of benchmarks/c can't be measured here; empty if it can."""
    return "" if c_program.path_of(name).exists() else "it has not been built: make -C benchmarks/c"


TUNED = "tuned malloc"
"""The end of the name of a series with MALLOC in the environment of all processes."""
MALLOC = MappingProxyType(
    {
        "MALLOC_MMAP_THRESHOLD_": str(32 << 20),
        "MALLOC_TRIM_THRESHOLD_": str(64 << 20),
        "MALLOC_TOP_PAD_": str(1 << 20),
    }
)
"""busd sets this in its own processes by glibc (bus.transport.memory): keep freed memory."""


def tuned(system: System) -> System:
    """`system` with settings of malloc for long messages in all its processes, as busd sets them itself."""
    return system._replace(name=f"{system.name}, {TUNED}", environ={**system.environ, **MALLOC})


_BY_SOCKET = MappingProxyType({"BUS_ROUTE": "socket"})
_STRING, _BYTES, _FAN = (f"benchmarks.adapters.bus_{name}" for name in ("string", "bytes", "fanout"))


def by_c(program: str, way: str) -> Mapping[str, str]:
    """The environment of a program of benchmarks/c, and of its way."""
    return MappingProxyType({c_program.PROGRAM: program, c_program.WAY: way})


BUS = System(
    "busd, shared memory",
    _STRING,
    _serve_bus,
    no_shared_memory,
    route="shm",
    kind="ours",
    guess=Speed(6_000_000, 15e9),
)
BUS_SOCKET = BUS._replace(
    name="busd, socket", missing=str, environ=_BY_SOCKET, route="socket", guess=Speed(4_000_000, 1.3e9)
)
BUS_BYTES = BUS._replace(module=_BYTES, guess=Speed(1_000_000, 15e9))
BUS_SOCKET_BYTES = BUS_SOCKET._replace(module=_BYTES)
BUS_FAN_OUT = BUS._replace(module=_FAN)
BUS_SOCKET_FAN_OUT = BUS_SOCKET._replace(module=_FAN)
BUS_BLOCKING = BUS._replace(
    name="busd, blocking API",
    module="benchmarks.adapters.bus_blocking",
    fans_out=False,
    takes_by="blocking",
    floods=False,
    gives_turns=False,
)
BUS_PLAIN, BUS_SOCKET_PLAIN = (
    system._replace(publisher=BUS_BLOCKING.module, gives_turns=False) for system in (BUS, BUS_SOCKET)
)
"""With a publisher that is a plain program, like most rivals' publishers: it sends, and then it sleeps."""
RCLPY = BUS._replace(
    name="busd, rclpy",
    module="benchmarks.adapters.rclpy_string",
    gives_turns=False,
    runner=(sys.executable, "-m", "bus_cli", "run", "--force"),
    guess=Speed(1_900_000, 1e9),
)
"""busd's facade, with the program that `ROS` runs."""
ASYNC_NODE = BUS._replace(
    name="busd, AsyncNode", module="benchmarks.adapters.async_node_string", runner=RCLPY.runner
)
"""busd's facade with nodes on asyncio's event loop, as in ROS 2 Lyrical."""
RCLPY_THREADS = RCLPY._replace(name="busd, rclpy, threads", environ=MappingProxyType({"BENCH_THREADS": "2"}))

FLOOR = System(
    "barest Python program",
    "benchmarks.adapters.floor_eventfd",
    kind="floor",
    fans_out=False,
    floods=False,
    largest=1 << 10,
    gives_turns=False,
)
TWO_HOPS = System(
    "two bare hops",
    "benchmarks.adapters.floor_two_hops",
    _serve_relay,
    kind="floor",
    fans_out=False,
    floods=False,
    largest=1 << 16,
)
C_FLOOR = System(
    "C, shared memory + eventfd",
    c_program.__name__,
    missing=no_c_program,
    environ=by_c("bare", "shm"),
    kind="floor",
    fans_out=False,
    guess=Speed(500_000, 30e9),
)
C_SOCKET = C_FLOOR._replace(
    name="C, UNIX socket", environ=by_c("bare", "socket"), guess=Speed(400_000, 1.5e9)
)

PIPE = System(
    "multiprocessing.Pipe",
    "benchmarks.adapters.pipe",
    fans_out=False,
    takes_by="blocking",
    gives_turns=False,
    guess=Speed(310_000, 2e9),
)
PYZMQ = System(
    "pyzmq",
    "benchmarks.adapters.zeromq",
    missing=_needs("zmq"),
    gives_turns=False,
    guess=Speed(1_700_000, 1e9),
)
PYZMQ_BLOCKING = PYZMQ._replace(name="pyzmq, blocking", fans_out=False, takes_by="blocking", floods=False)
PYZMQ_PROXY = PYZMQ._replace(
    name="pyzmq, XSUB/XPUB proxy",
    module="benchmarks.adapters.zeromq_proxy",
    serve=_serve_relay,
    kind="brokered",
)
QUEUE = PIPE._replace(
    name="multiprocessing.Queue", module="benchmarks.adapters.mp_queue", guess=Speed(160_000, 700e6)
)
NATS = System(
    "nats-py",
    "benchmarks.adapters.nats_core",
    serve_nats,
    _needs("nats", server="nats-server"),
    kind="brokered",
    guess=Speed(140_000, 250e6),
)
REDIS = System(
    "redis-py",
    "benchmarks.adapters.redis_pubsub",
    serve_redis,
    _needs("redis", server="redis-server"),
    kind="brokered",
    gives_turns=False,
    guess=Speed(160_000, 600e6),
)
ICEORYX = System(
    "iceoryx2",
    "benchmarks.adapters.iceoryx",
    missing=_needs("iceoryx2"),
    takes_by="event",
    gives_turns=False,
    guess=Speed(350_000, 8e9),
)

ZENOH = System(
    "eclipse-zenoh",
    "benchmarks.adapters.zenoh_peer",
    missing=_needs("zenoh"),
    gives_turns=False,
    guess=Speed(500_000, 4e9),
)
SHIPPED = "BENCH_ECAL_SHIPPED"
"""If this is set, eCAL's processes look for each other in eCAL's default interval."""
ECAL = System(
    "eclipse-ecal",
    "benchmarks.adapters.ecal_shm",
    missing=_needs("ecal"),
    gives_turns=False,
    guess=Speed(15_000, 800e6),
)
ECAL_SHIPPED = ECAL._replace(name="eclipse-ecal, as shipped", environ=MappingProxyType({SHIPPED: "1"}))
CYCLONE = System(
    "cyclonedds",
    "benchmarks.adapters.cyclone",
    missing=_needs("cyclonedds"),
    gives_turns=False,
    guess=Speed(45_000, 400e6),
)
ROS = System(
    "rclpy, Fast DDS",
    RCLPY.module,
    _serve_ros,
    ros.missing,
    environ=MappingProxyType({"BENCH_DEEP": "1"}),
    gives_turns=False,
    runner=(str(ros.PYTHON),),
    guess=Speed(6_000, 200e6),
)
"""ROS 2's own rclpy, with its default settings."""
ROS_LARGE = ROS._replace(name=f"{ROS.name}, large segment", serve=_serve_ros_large)
"""The same with a segment of shared memory that is large enough for long messages."""

FLOORS = (FLOOR, TWO_HOPS, C_FLOOR, C_SOCKET)
RIVALS = (PIPE, QUEUE, PYZMQ, PYZMQ_BLOCKING, PYZMQ_PROXY, NATS, REDIS, ICEORYX, ZENOH, ECAL, CYCLONE, ROS)
SYSTEMS = (BUS, BUS_BLOCKING, BUS_SOCKET, *FLOORS, *RIVALS)

ESSENTIAL = frozenset(
    system.name
    for system in (
        *(BUS, BUS_BLOCKING, BUS_SOCKET, FLOOR),
        *(PIPE, PYZMQ, PYZMQ_BLOCKING, PYZMQ_PROXY, ICEORYX, ECAL),
    )
)
"""Names of systems that goals compare. They are measured more often than the others."""


def of_kind(*kinds: Kind) -> list[System]:
    """The systems of these kinds, in the order of `SYSTEMS`."""
    return [system for system in SYSTEMS if system.kind in kinds]
