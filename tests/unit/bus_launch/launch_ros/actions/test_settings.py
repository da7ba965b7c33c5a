"""bus_launch.launch_ros.actions.settings: the folder of log files."""

from pathlib import Path

import pytest

from bus_launch.launch import logging
from bus_launch.launch.core import LaunchContext
from bus_launch.launch.launch_description_sources import get_launch_description_from_any_launch_file
from bus_launch.launch_ros.actions import SetROSLogDir
from bus_launch.launch_ros.descriptions import Parameter, ParameterFile


def test_a_relative_folder_of_logs_is_in_the_present_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    logging.reset()
    context = LaunchContext()
    file = tmp_path / "a.launch.xml"
    file.write_text('<launch><set_ros_log_dir new_log_dir="in/it"/></launch>')
    (action,) = get_launch_description_from_any_launch_file(str(file)).entities
    action.visit(context)
    assert context.environment["ROS_LOG_DIR"] == str(tmp_path / "log/in/it")
    SetROSLogDir(str(tmp_path / "other")).visit(context)
    assert context.environment["ROS_LOG_DIR"] == str(tmp_path / "other")
    assert (tmp_path / "log/in/it").is_dir() and (tmp_path / "other").is_dir()
    logging.reset()


def test_properties_of_descriptions() -> None:
    parameter = Parameter("a", 5, value_type=int, description="of a")
    assert parameter.value_type is int
    assert [one.describe() for one in parameter.description] == ["'of a'"]
    assert ParameterFile("a.yaml", allow_substs=True).allow_substs is True
