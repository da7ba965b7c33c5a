"""`bus completion`: the names of the program that the shell completes."""

import os
import sys
from pathlib import Path

import pytest

from bus_cli.completion import _names
from bus_cli.ros2.script import script_text


@pytest.fixture
def ros2(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The path of a `ros2` in the only folder of PATH; it does not exist yet."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(sys, "argv", ["bus", "completion", "bash"])
    return tmp_path / "ros2"


def test_ros2_is_completed_if_it_is_ours(ros2: Path) -> None:
    assert _names() == ["bus"]
    ros2.write_text(script_text(sys.executable))
    ros2.chmod(0o755)
    assert os.access(ros2, os.X_OK)
    assert _names() == ["bus", "ros2"]
    ros2.write_text("#!/bin/sh\n")
    assert _names() == ["bus"]


def test_ros2_is_completed_if_the_user_has_called_it(ros2: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["/env/bin/ros2", "completion", "bash"])
    assert _names() == ["bus", "ros2"]
