"""A peer as a test has it: started, told what to do, its answers and what it heard."""

import contextlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, ParamSpec, Self, TypeVar, get_args
from zlib import crc32

import pytest

from conftest import SOON_S, WAIT_S
from netns import Machine

ROOT = Path(__file__).parents[2]
PROGRAMS = Path(__file__).parent / "programs"
Distro = Literal["jazzy", "kilted"]
_DISTROS = get_args(Distro)
P = ParamSpec("P")
R = TypeVar("R")

_LOOPBACK_ONLY = (
    "<CycloneDDS><Domain><General><Interfaces>"
    "<NetworkInterface address='127.0.0.1' multicast='false'/></Interfaces></General>"
    "<Compatibility><IgnoreTypeInformation>1.15,1.16</IgnoreTypeInformation></Compatibility>"
    "<Discovery><Peers><Peer address='127.0.0.1'/></Peers><ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex></Discovery></Domain></CycloneDDS>"
)

_SERVER = """<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><profiles>
<participant profile_name="server" is_default_profile="true"><rtps>
<prefix>44.53.00.5f.45.50.52.4f.53.49.4d.41</prefix>
<builtin><discovery_config><discoveryProtocol>SERVER</discoveryProtocol></discovery_config>
<metatrafficUnicastLocatorList><locator><udpv4><address>{}</address><port>{}</port></udpv4></locator>
</metatrafficUnicastLocatorList></builtin></rtps></participant></profiles></dds>
"""
"""A profile of Fast DDS. The prefix is that of the first server in ROS_DISCOVERY_SERVER."""


def each_distro(test: Callable[P, R]) -> Callable[P, R]:
    """Run a test with each distribution; in `make test` only with one of them, which its name selects."""
    daily = _DISTROS[crc32(test.__name__.encode()) & 1]
    cases = [pytest.param(one, marks=() if one == daily else pytest.mark.nightly, id=one) for one in _DISTROS]
    made: Callable[P, R] = pytest.mark.parametrize("distro", cases)(test)
    return made


def python_of(distro: Distro) -> Path:
    return ROOT / f".venv-{distro}" / "bin" / "python"


@cache
def why_no_ros(distro: Distro, package: str = "rclpy") -> str:
    """Why there is no such package of that distribution; empty where there is one."""
    site = python_of(distro).parents[1].glob(f"lib/python*/site-packages/{package}")
    return "" if any(site) else f"ROS 2's own {package} ({distro}) is not installed: make peers"


class Peer:
    """A program of `programs/`, whose standard error goes to a file that a failure shows."""

    def __init__(
        self, command: Sequence[str], environ: Mapping[str, str] | None = None, machine: Machine | None = None
    ) -> None:
        self.heard: defaultdict[str, list[dict[str, Any]]] = defaultdict(list)
        """Messages by topic, in the order in which they came."""
        self.source_times_ns: defaultdict[str, list[int]] = defaultdict(list)
        self._answers: list[dict[str, Any]] = []
        self._news = threading.Condition()
        self._has_ended = False
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115
        self.process = subprocess.Popen(
            [*(machine.prefix if machine else ()), *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            env={**os.environ, **(environ or {})},
        )
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        try:
            self._take_answer("ready")
        except BaseException:
            self.close()
            raise

    def ask(self, order: str, /, **arguments: Any) -> Any:
        """Give an order, and return the answer."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps([order, arguments]) + "\n")
        self.process.stdin.flush()
        return self._take_answer(order)

    def wait(self, topic: str, count: int = 1) -> list[dict[str, Any]]:
        """The messages of a topic, once there are so many."""
        self._wait_until(lambda: len(self.heard[topic]) >= count, f"{count} messages on {topic}")
        return self.heard[topic]

    def wait_for(self, order: str, fits: Callable[[Any], object], /, **arguments: Any) -> Any:
        """The first answer that fits. Raises TimeoutError."""
        end = time.monotonic() + WAIT_S
        while not fits(answer := self.ask(order, **arguments)):
            if time.monotonic() > end:
                raise TimeoutError(f"{order} {arguments}: {answer}")
            time.sleep(0.02)
        return answer

    def kill(self) -> None:
        self.process.kill()
        self.process.wait(WAIT_S)

    def close(self) -> None:
        assert self.process.stdin is not None and self.process.stdout is not None
        with contextlib.suppress(BrokenPipeError):  # an order that the killed process did not read
            self.process.stdin.close()
        try:
            self.process.send_signal(signal.SIGCONT)
            self.process.wait(SOON_S)
        except subprocess.TimeoutExpired:
            self.kill()
        self._thread.join(WAIT_S)
        self.process.stdout.close()
        self._errors.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _take_answer(self, order: str) -> Any:
        self._wait_until(lambda: self._answers, f"answer to {order!r}")
        with self._news:
            answer = self._answers.pop(0)
        if "error" in answer:
            pytest.fail(answer["error"])
        return answer["answer"]

    def _wait_until(self, holds: Callable[[], object], what: str) -> None:
        end = time.monotonic() + WAIT_S
        with self._news:
            while not holds():
                left_s = end - time.monotonic()
                if self._has_ended or left_s <= 0:
                    self._errors.seek(0)
                    raise TimeoutError(f"no {what}; stderr: {self._errors.read()[-2000:]}")
                self._news.wait(left_s)

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if not line.startswith("{"):
                continue  # what a library prints for people
            event = json.loads(line)
            with self._news:
                if "heard" in event:
                    self.heard[event["heard"]].append(event["message"])
                    self.source_times_ns[event["heard"]].append(event.get("source_time_ns", 0))
                else:
                    self._answers.append(event)
                self._news.notify_all()
        with self._news:
            self._has_ended = True
            self._news.notify_all()


def ros(
    distro: Distro,
    name: str,
    machine: Machine | None,
    *,
    namespace: str = "",
    domain: int = 0,
    reach: Literal["LOCALHOST", "SUBNET"] = "LOCALHOST",
    static_peers: str = "",
    variables: Mapping[str, str] | None = None,
) -> Peer:
    """A node of ROS 2's own rclpy, that looks for others on its machine only.

    Skips the test if there is no such rclpy here.

    SUBNET is what ROS 2 does by default, and is for machines of a test: it calls on all networks.
    `variables`: further ones of the environment.
    """
    if reason := why_no_ros(distro):
        pytest.skip(reason)
    environ = {
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": reach,
        "ROS_STATIC_PEERS": static_peers,
        "ROS_LOG_DIR": tempfile.gettempdir(),
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "PYTHONPATH": "",
        **(variables or {}),
    }
    command = (str(python_of(distro)), str(PROGRAMS / "ros.py"), name, *([namespace] if namespace else []))
    return Peer(command, environ, machine)


def discovery_server(
    distro: Distro, machine: Machine | None, address: tuple[str, int], folder: Path, *, domain: int = 0
) -> Peer:
    """A Discovery Server of Fast DDS, in the process of the node /server.

    Skips the test if there is no rclpy.
    """
    profile = folder / "server.xml"
    profile.write_text(_SERVER.format(*address))
    names = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")
    profiles = dict.fromkeys(names, str(profile))
    # LOCALHOST would choose other addresses. A server calls only those that have called it.
    return ros(distro, "server", machine, domain=domain, reach="SUBNET", variables=profiles)


def cyclone(machine: Machine | None, *, domain: int = 0) -> Peer:
    """A participant of cyclonedds alone, on loopback."""
    if importlib.util.find_spec("cyclonedds") is None:
        pytest.skip("cyclonedds is not installed: make setup installs it")
    environ = {"CYCLONEDDS_URI": _LOOPBACK_ONLY}
    return Peer((sys.executable, str(PROGRAMS / "cyclone.py"), str(domain)), environ, machine)


def zenoh(machine: Machine | None, way: Literal["listen", "connect"], endpoint: str) -> Peer:
    """A session of zenoh alone."""
    if importlib.util.find_spec("zenoh") is None:
        pytest.skip("eclipse-zenoh is not installed: make setup installs it")
    return Peer((sys.executable, str(PROGRAMS / "zenoh_alone.py"), way, endpoint), None, machine)
