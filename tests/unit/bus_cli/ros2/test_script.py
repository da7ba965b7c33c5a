"""The file `ros2` of `bus ros2 install`: its text, its folder, and other files of this name."""

import os
import subprocess
import sys
import sysconfig
from argparse import Namespace
from pathlib import Path

import pytest

from bus_cli.output import CommandError
from bus_cli.ros2.script import MARK, folder_of, foreign, is_ours, script_text

NO_FOLDER = Namespace(into=None)


def executable(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)
    return path


@pytest.mark.parametrize("folder", ["env", "an env's", "long" * 50])
def test_the_file_runs_in_the_given_python(tmp_path: Path, folder: str) -> None:
    python = executable(
        tmp_path / folder / "python", f'#!/bin/sh\necho "{MARK[2:6]}"\nexec {sys.executable} "$@"\n'
    )
    ros2 = executable(tmp_path / "ros2", script_text(str(python)))
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([ros2, "topic"], capture_output=True, text=True, env=env, check=True)
    assert done.stdout.startswith("This\nusage: ros2 topic ")
    assert is_ours(ros2)


def test_a_file_without_its_busd_names_itself(tmp_path: Path) -> None:
    ros2 = executable(tmp_path / "ros2", script_text(sys.executable))
    done = subprocess.run([sys.executable, "-IS", ros2], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("ros2: busd is not installed in ")
    assert "remove this file" in done.stderr


def test_a_ros2_of_another_origin(tmp_path: Path) -> None:
    here, other = tmp_path / "here", tmp_path / "other"
    here.mkdir()
    path = [str(other), str(here)]
    assert foreign(here, path) is None
    executable(here / "ros2", script_text(sys.executable))
    assert foreign(here, path) is None
    genuine = executable(other / "ros2", "#!/usr/bin/python3\n")
    assert foreign(here, path) == genuine
    genuine.chmod(0o644)  # a shell does not run it
    assert foreign(here, path) is None
    assert foreign(other, path) == genuine
    genuine.unlink()
    genuine.symlink_to("nowhere")
    assert foreign(other, []) == genuine


def test_what_can_not_be_read_is_not_ours(tmp_path: Path) -> None:
    (tmp_path / "ros2").mkdir()
    assert not is_ours(tmp_path / "ros2")
    assert not is_ours(tmp_path / "ros2" / "nothing")
    assert foreign(tmp_path, []) == tmp_path / "ros2"


def test_the_ros2_of_a_launch_is_ours() -> None:
    import bus_launch

    assert is_ours(Path(str(bus_launch.__file__)).parent / "inherited" / "ros2")


def test_the_folder_is_that_of_the_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started = executable(tmp_path / "one" / "bus", "")
    scripts = executable(tmp_path / "two" / "bus", "").parent
    user = executable(tmp_path / "three" / "bus", "").parent
    folders = {sysconfig.get_default_scheme(): scripts, sysconfig.get_preferred_scheme("user"): user}
    monkeypatch.setattr(sysconfig, "get_path", lambda name, scheme: str(folders[scheme]))
    monkeypatch.setattr(sys, "argv", [str(started), "ros2", "install"])
    assert folder_of(NO_FOLDER) == started.parent
    monkeypatch.setattr(sys, "argv", ["/x/bus_cli/__main__.py"])
    assert folder_of(NO_FOLDER) == scripts
    (scripts / "bus").unlink()
    assert folder_of(NO_FOLDER) == user
    (user / "bus").unlink()
    with pytest.raises(CommandError, match="choose a folder with --into FOLDER"):
        folder_of(NO_FOLDER)
    assert folder_of(Namespace(into=str(tmp_path / "nowhere"))) == tmp_path / "nowhere"
    (tmp_path / "file").touch()
    with pytest.raises(CommandError, match="/file is not a folder"):
        folder_of(Namespace(into=str(tmp_path / "file")))
