"""Two buses with bridges between them, a bus with a bridge to DDS or to ROS 2, and rivals without a bus.

Everything runs on loopback, so no figure includes a network.
"""

import signal
import socket
import sys
from collections.abc import Callable, Mapping
from functools import partial
from importlib.util import find_spec

from benchmarks import ros
from benchmarks.harness import Child, Group
from benchmarks.systems import BUS, CYCLONE, RCLPY, ROS, ZENOH, Speed
from bus.base.optional import how_to_install

ENGINES = {"zenoh": ("zenoh", "eclipse-zenoh"), "ros2": ("cyclonedds", "cyclonedds")}
"""For each engine, the module that it needs and the distribution with that module."""
FAR = "far"
"""The name of the second bus: its socket is far.sock."""


def missing(engine: str) -> str:
    """The reason why a bridge can't be measured here; empty if it can."""
    module, distribution = ENGINES[engine]
    if find_spec(module) is None:
        return f"{module} is not installed: {how_to_install(distribution)}"
    return BUS.missing()


def free_port() -> int:
    """A free TCP port of loopback."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port: int = one.getsockname()[1]
    return port


def start_bridge(group: Group, engine: str, *arguments: str, name: str, bus: str = "busd") -> Child:
    """Start `bus bridge` for the bus with that name."""
    command = (sys.executable, "-m", "bus_cli", "bridge", engine, *arguments)
    environ = {"BUSD_SOCKET": str(group.folder / f"{bus}.sock")}
    return group.start(name, *command, environ=environ, stop_signal=signal.SIGINT)


def serve_two(group: Group, module: str) -> list[Child]:
    """Start two buses and their bridges, connected by zenoh. Processes started later use the first bus."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    far = group.start_busd(name=FAR)
    near = group.start_busd()
    return [
        near,
        far,
        start_bridge(group, "zenoh", "--listen", endpoint, name="far_bridge", bus=FAR),
        start_bridge(group, "zenoh", "--connect", endpoint, name="near_bridge"),
    ]


def serve_ros2(group: Group, module: str, carrier: str = "cyclonedds") -> list[Child]:
    """Start a bus, and its bridge to a domain of DDS on loopback."""
    domain = ros.environ(group.folder)["ROS_DOMAIN_ID"]
    group.environ["BENCH_ROS"] = domain
    busd = group.start_busd()
    return [busd, start_bridge(group, "ros2", "--domain-id", domain, "--carrier", carrier, name="bridge")]


def serve_with_ros(group: Group, module: str = "") -> list[Child]:
    """Start a bus, and its bridge to the domain of programs of ROS 2, on loopback."""
    group.environ.update(ros.environ(group.folder) | ros.with_large_buffers(group.folder))
    busd = group.start_busd()
    words = ("--domain-id", group.environ["ROS_DOMAIN_ID"])
    return [busd, start_bridge(group, "ros2", *words, name="bridge")]


def without_ros() -> str:
    """As `missing`, for programs of ROS 2."""
    return missing("ros2") or ros.missing()


def _serve_endpoint(group: Group, module: str) -> list[Child]:
    group.environ["BENCH_ENDPOINT"] = f"tcp/127.0.0.1:{free_port()}"
    return []


def _subscribers_are_far(group: Group, role: str) -> Mapping[str, str]:
    return {"BUSD_SOCKET": str(group.folder / f"{FAR}.sock")} if role == "subscriber" else {}


def _without(engine: str) -> Callable[[], str]:
    return lambda: missing(engine)


PLAIN_ZENOH = ZENOH._replace(name="eclipse-zenoh, TCP", serve=_serve_endpoint)
NUMBERED_ZENOH = PLAIN_ZENOH._replace(
    name=f"{PLAIN_ZENOH.name}, numbered", environ={"BENCH_ATTACHMENT": "1"}, guess=Speed(200_000, 500e6)
)
PLAIN_DDS = CYCLONE
BY_ZENOH = BUS._replace(
    name="busd - zenoh - busd",
    serve=serve_two,
    missing=_without("zenoh"),
    route="bridge",
    place=_subscribers_are_far,
    guess=PLAIN_ZENOH.guess,
)
TO_DDS = BUS._replace(
    name="busd - cyclonedds",
    serve=serve_ros2,
    missing=_without("ros2"),
    publisher=BUS.module,
    module=CYCLONE.module,
    route="bridge",
    guess=CYCLONE.guess,
)
FROM_DDS = TO_DDS._replace(name="cyclonedds - busd", publisher=CYCLONE.module, module=BUS.module, route="")

_BY_RTPS = partial(serve_ros2, carrier="rtps")
TO_DDS_BY_RTPS = TO_DDS._replace(name="busd - RTPS - cyclonedds", serve=_BY_RTPS)
FROM_DDS_BY_RTPS = FROM_DDS._replace(name="cyclonedds - RTPS - busd", serve=_BY_RTPS)

TO_ROS = RCLPY._replace(
    name="busd, rclpy - rclpy, Fast DDS",
    serve=serve_with_ros,
    missing=without_ros,
    route="bridge",
    runner=ROS.runner,
    publisher_runner=RCLPY.runner,
    guess=ROS.guess,
)
"""The same program at both ends: on busd's facade, and on ROS 2."""
FROM_ROS = TO_ROS._replace(
    name="rclpy, Fast DDS - busd, rclpy", route="", runner=RCLPY.runner, publisher_runner=ROS.runner
)

SYSTEMS = (
    PLAIN_ZENOH,
    NUMBERED_ZENOH,
    PLAIN_DDS,
    BUS,
    BY_ZENOH,
    TO_DDS,
    FROM_DDS,
    TO_DDS_BY_RTPS,
    FROM_DDS_BY_RTPS,
)
"""The rivals come first."""
