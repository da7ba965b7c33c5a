"""The programs of tf2 as users start them: `bus run tf2_ros static_transform_publisher`, and so on."""

import signal
from pathlib import Path

import pytest

from bus_ros import packages
from cli import bus
from packaged import run_bus
from programs import on_one_loop, running

RUN = ("-m", "bus_cli", "run")
STAMP = r"\[\d{10}\.\d{9}\]"

pytestmark = pytest.mark.usefixtures("daemon")


@on_one_loop
async def test_a_static_transform(tmp_path: Path) -> None:
    words = ["--x", "1", "--frame-id", "world", "--child-frame-id", "robot"]
    async with running(tmp_path, *RUN, "tf2_ros", "static_transform_publisher", *words) as publisher:
        await publisher.line("^from 'world' to 'robot'$")
        heard = bus(
            "topic", "echo", "--once", "/tf_static", "--field", "transforms[0].transform.translation.x"
        )
        assert heard.out.startswith("1.0\n")
        publisher.process.send_signal(signal.SIGINT)
        assert await publisher.end() == 0
    first, *rest = publisher.lines
    assert first.endswith(": Spinning until stopped - publishing transform")
    assert rest == [
        "translation: ('1.000000', '0.000000', '0.000000')",
        "rotation: ('0.000000', '0.000000', '0.000000', '1.000000')",
        "from 'world' to 'robot'",
    ]


def test_what_is_wrong_is_said() -> None:
    said = run_bus("run", "tf2_ros", "static_transform_publisher", "--x", "far")
    assert said.code == 1
    assert ": error parsing command line arguments: Failed to parse --x argument as float\n" in said.err
    assert said.out.startswith("usage: static_transform_publisher [--x X] ")
    said = run_bus(
        "run", "tf2_ros", *["static_transform_publisher", "--frame-id", "a", "--child-frame-id", "a"]
    )
    assert said.code == 1
    assert ": cannot publish static transform from 'a' to 'a', exiting\n" in said.err


def test_they_are_found_like_those_of_packages() -> None:
    found = packages.executables("tf2_ros")
    assert found is not None
    assert "static_transform_publisher" in [one.name for one in found]
    assert "tf2_ros static_transform_publisher\n" in bus("pkg", "executables", "tf2_ros").out
    assert bus("run", "tf2_ros", "static_transform").err == (
        "No executable found\ndid you mean 'static_transform_publisher'?\n"
    )
    assert bus("run", "tf2_ro", "x").err == "Package 'tf2_ro' not found\ndid you mean 'tf2_ros'?\n"
