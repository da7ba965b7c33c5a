"""bus_cli.doctor.bridges: packages, tables of busd.toml, ports, a router, receive buffers."""

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from bus_bridge import extras
from bus_cli.doctor import bridges
from bus_cli.doctor.finding import Finding
from rows import for_each


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "busd.toml"


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """The modules of installed extras. A test may change the set."""
    found = {"xxhash", *(extra.module for extra in extras.EXTRAS.values())}
    monkeypatch.setattr(extras, "find_spec", lambda name: object() if name in found else None)
    monkeypatch.setattr(bridges, "version", lambda name: "1.2.3")
    return found


@pytest.fixture
def buffers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Replaces /proc/sys/net/core."""
    for name in ("rmem_default", "rmem_max"):
        (tmp_path / name).write_text(f"{4 << 20}\n")
    monkeypatch.setattr(bridges, "_BUFFERS", tmp_path)
    return tmp_path


@pytest.fixture
def taken() -> Iterator[int]:
    """A port at which another program listens."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        yield other.getsockname()[1]


def test_all_is_there(installed: set[str], buffers: Path) -> None:
    assert [*bridges.examine(None)] == [
        Finding("ok", "bridges", "eclipse-zenoh 1.2.3"),
        Finding("ok", "bridges", "cyclonedds 1.2.3"),
        Finding("ok", "receive buffers", "net.core.rmem_default = 4194304, net.core.rmem_max = 4194304"),
    ]


def test_what_is_missing_is_no_fault_where_nobody_wants_it(
    installed: set[str], file: Path, buffers: Path
) -> None:
    installed.clear()
    file.write_text("log_level = 'info'")
    found = [*bridges.examine(file)]
    assert [one.mark for one in found] == ["ok", "ok", "ok"]
    assert found[0].text == "a bridge to zenoh needs eclipse-zenoh: pip install 'eclipse-zenoh>=1.10,<2'"


def test_what_is_missing_and_stands_in_the_file(installed: set[str], file: Path) -> None:
    installed.clear()
    file.write_text("[bridge.zenoh]\nlisten = 'tcp/127.0.0.1:7447'")
    assert next(bridges.examine(file)) == Finding(
        "warn", "bridges", "a bridge to zenoh needs eclipse-zenoh", "pip install 'eclipse-zenoh>=1.10,<2'"
    )


def test_a_mistake_in_the_file(installed: set[str], file: Path) -> None:
    file.write_text("[bridge.zenoh]\nlisen = 'tcp/127.0.0.1:7447'")
    assert next(bridges.examine(file)) == Finding(
        "fail",
        "bridges",
        f"{file}: unknown key 'bridge.zenoh.lisen'; did you mean 'listen'?",
        "correct it: no such bridge starts with it",
    )


def test_a_port_that_is_free_and_one_that_is_not(installed: set[str], file: Path, taken: int) -> None:
    def of_ports(*running: str) -> list[Finding]:
        return [one for one in bridges.examine(file, running) if "127.0.0.1" in one.text]

    place = f"tcp/127.0.0.1:{taken}"
    file.write_text(f"[bridge.zenoh]\nlisten = '{place}'")
    assert of_ports() == [
        Finding(
            "warn",
            "bridges",
            f"{place} is in use by another program",
            "stop that program, or choose another port",
        )
    ]
    assert of_ports("zenoh") == [Finding("ok", "bridges", f"{place} is in use, and a bridge runs")]
    place = place.replace("tcp", "quic")  # by UDP; no program listens there
    file.write_text(f"[bridge.zenoh]\nlisten = '{place}'")
    assert of_ports() == [Finding("ok", "bridges", f"{place} is free")]


@for_each(
    ("place", "mark"),
    [("tcp/192.0.2.1:7447", "warn"), ("tcp/robot.local:7447", "ok"), ("7447", "fail")],
)
def test_an_address_that_can_t_be(installed: set[str], file: Path, place: str, mark: str) -> None:
    file.write_text(f"[bridge.zenoh]\nlisten = '{place}'")
    (found,) = (one for one in bridges.examine(file) if place in one.text)
    assert found.mark == mark


def test_receive_buffers_as_kernels_have_them(installed: set[str], buffers: Path) -> None:
    (buffers / "rmem_default").write_text("212992\n")
    assert [*bridges.examine(None)][-1] == Finding(
        "warn",
        "receive buffers",
        "net.core.rmem_default = 212992, net.core.rmem_max = 4194304: nodes of ROS 2 here may lose large "
        "images",
        "sysctl -w net.core.rmem_default=4194304 net.core.rmem_max=4194304",
    )
    (buffers / "rmem_default").unlink()
    (buffers / "rmem_max").unlink()
    assert [*bridges.examine(None)][-1] == Finding("ok", "receive buffers", "not visible here")


ON_ZENOH = "[bridge.ros2]\nrmw = 'zenoh'\n"


def of_ros2(file: Path) -> list[Finding]:
    """The findings after those of zenoh's bridge."""
    return [*bridges.examine(file)][1:]


def test_packages_for_ros_2_on_zenoh(installed: set[str], file: Path) -> None:
    installed.discard("xxhash")
    file.write_text(ON_ZENOH)
    assert of_ros2(file) == [
        Finding("warn", "bridges", "a bridge to ROS 2 on zenoh needs xxhash", "pip install 'xxhash>=3,<5'")
    ]


def test_the_router_of_ros_2_on_zenoh(installed: set[str], file: Path, taken: int) -> None:
    place = f"tcp/localhost:{taken}"
    file.write_text(f"{ON_ZENOH}connect = '{place}'")
    packages = Finding("ok", "bridges", "eclipse-zenoh 1.2.3, xxhash 1.2.3")
    assert of_ros2(file) == [packages, Finding("ok", "bridges", f"a router answers at {place}")]
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))  # and does not listen
        place = f"tcp/localhost:{other.getsockname()[1]}"
        file.write_text(f"{ON_ZENOH}connect = '{place}'")
        text = f"no router at {place}: nodes of ROS 2 on zenoh find each other by it"
        assert of_ros2(file)[1] == Finding("warn", "bridges", text, "ros2 run rmw_zenoh_cpp rmw_zenohd")


def test_other_addresses_of_ros_2_on_zenoh(installed: set[str], file: Path, taken: int) -> None:
    file.write_text(f"{ON_ZENOH}connect = 'tcp/192.0.2.1:7447'\ninsecure = true")
    assert len(of_ros2(file)) == 1  # another machine is not asked
    place = f"tcp/127.0.0.1:{taken}"
    file.write_text(f"{ON_ZENOH}listen = '{place}'")
    assert of_ros2(file)[1].text == f"{place} is in use by another program"


@for_each(("running", "marks"), [((), ["warn"]), (("ros2",), ["warn"]), (("rmw_zenoh",), [])])
def test_nodes_of_this_shell_use_zenoh(
    installed: set[str], buffers: Path, running: tuple[str, ...], marks: list[str]
) -> None:
    found = bridges.examine(None, running, {"RMW_IMPLEMENTATION": "rmw_zenoh_cpp"})
    assert [one.mark for one in found if "RMW_IMPLEMENTATION" in one.text] == marks
