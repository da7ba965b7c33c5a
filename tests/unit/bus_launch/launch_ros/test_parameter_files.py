"""bus_launch.launch_ros.parameter_files: arguments for files and dicts, and the end of temporary files."""

from pathlib import Path

import pytest
import yaml

from bus_launch.launch import logging
from bus_launch.launch.core import LaunchContext, TextSubstitution
from bus_launch.launch_ros.descriptions import ParameterFile
from bus_launch.launch_ros.parameter_files import FileArguments
from bus_launch.launch_ros.utilities import normalize_parameters


def test_arguments_come_in_the_order_of_the_parameters_and_later_ones_hold(tmp_path: Path) -> None:
    given = tmp_path / "given.yaml"
    given.write_text("/**: {ros__parameters: {a: 1}}")
    files = FileArguments()
    words = files.make(
        LaunchContext(), normalize_parameters([{"a": 2}, str(given), {}, {"a": 3}]), "/ns/talker"
    )
    assert words[::2] == ["--params-file"] * 3
    assert words[3] == str(given)
    values = [yaml.safe_load(Path(path).read_text()) for path in words[1::2]]
    assert [list(one) for one in values] == [["/ns/talker"], ["/**"], ["/ns/talker"]]
    assert [next(iter(one.values()))["ros__parameters"]["a"] for one in values] == [2, 1, 3]
    files.remove()
    assert [Path(path).exists() for path in words[1::2]] == [False, True, False]
    files.remove()


def test_a_file_with_substitutions_is_written_anew(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("/**: {ros__parameters: {a: $(var x)}}")
    context = LaunchContext()
    context.launch_configurations["x"] = "7"
    files = FileArguments()
    (_, path) = files.make(context, [ParameterFile(str(file), allow_substs=True)], "/**")
    assert path != str(file)
    assert Path(path).read_text() == "/**: {ros__parameters: {a: 7}}"
    (_, path) = files.make(context, [ParameterFile(str(file))], "/**")
    assert path == str(file)
    files.remove()
    assert file.exists()


def test_a_program_starts_without_a_file_that_is_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    logging.reset()
    file = ParameterFile([TextSubstitution(text="/no/such.yaml")])
    assert FileArguments().make(LaunchContext(), [file], "/**") == []
    assert "Parameter file path is not a file: /no/such.yaml" in capsys.readouterr().out
    logging.reset()
