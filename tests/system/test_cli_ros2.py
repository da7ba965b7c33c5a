"""`bus ros2`: the program under the name `ros2`, for other programs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import WAIT_S

BUS = "import sys\nfrom bus_cli.entry import main\nsys.exit(main())\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in PATH with the program `bus`, as pip installs it."""
    folder = tmp_path / "my bin"
    folder.mkdir()
    program = folder / "bus"
    program.write_text(f"#!{sys.executable}\n{BUS}")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}/usr/bin{os.pathsep}/bin")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))
    return folder


def shell(line: str) -> tuple[str, str, int]:
    """Run a line as make does: an alias of the user's shell does not count."""
    done = subprocess.run(
        ["/bin/sh", "-c", line], capture_output=True, text=True, timeout=WAIT_S, check=False
    )
    return done.stdout, done.stderr, done.returncode


def test_install_use_and_uninstall(folder: Path, daemon: object) -> None:
    ros2 = folder / "ros2"
    assert shell("bus ros2 uninstall") == (f"{ros2} is not there\n", "", 0)
    assert shell("bus ros2 install") == (f"Wrote {ros2}\n", "", 0)
    assert shell("bus ros2 install") == (f"{ros2} is already there\n", "", 0)
    assert shell("ros2 topic type /nosuch") == ("", "", 1)
    assert shell("ros2 daemon status") == ("The daemon is running\n", "", 0)
    assert shell("ros2 tpoic")[1] == "ros2: there is no command 'tpoic'; did you mean 'ros2 topic'?\n"
    assert shell("ros2 run -m platform")[2] == 0
    assert shell("ros2 ros2 install --json") == (f'{{"file":"{ros2}","written":false}}\n', "", 0)
    ros2.chmod(0o644)
    assert shell("bus ros2 install") == (f"Wrote {ros2}\n", "", 0)
    assert os.access(ros2, os.X_OK)
    assert shell("ros2 ros2 uninstall --json") == (f'{{"file":"{ros2}","removed":true}}\n', "", 0)
    assert sorted(path.name for path in folder.iterdir()) == ["bus"]


def test_a_ros2_of_another_origin_stays(folder: Path, tmp_path: Path) -> None:
    genuine = folder / "ros2"
    genuine.write_text("#!/bin/sh\necho genuine\n")
    genuine.chmod(0o755)
    refusal = f"{genuine} is not from busd; nothing was written, because one would hide the other\n"
    assert shell("bus ros2 install") == ("", refusal, 1)
    other = tmp_path / "other"
    other.mkdir()
    assert shell(f"bus ros2 install --into {other}") == ("", refusal, 1)
    assert shell("bus ros2 uninstall") == ("", f"{genuine} is not from busd; it was not removed\n", 1)
    assert shell("ros2") == ("genuine\n", "", 0)
    assert list(other.iterdir()) == []


def test_another_folder(folder: Path, tmp_path: Path) -> None:
    """The verb makes a missing folder."""
    other = tmp_path / "new" / "other"
    assert shell(f"bus ros2 uninstall --into {other}") == (f"{other}/ros2 is not there\n", "", 0)
    (tmp_path / "file").touch()
    assert shell(f"bus ros2 install --into {tmp_path}/file/bin") == (
        "",
        f"can't write {tmp_path}/file/bin/ros2: Not a directory\n",
        1,
    )
    assert shell(f"bus ros2 install --into {other}") == (
        f"Wrote {other}/ros2\n",
        f"the shell does not find it yet: {other} is not in PATH\n",
        0,
    )
    assert shell("bus ros2 install")[0] == f"Wrote {folder}/ros2\n"
    assert shell(f"bus ros2 install --into {other}") == (
        f"{other}/ros2 is already there\n",
        f"the shell finds another one of busd first: {folder}/ros2\n",
        0,
    )
    assert shell(f"bus ros2 uninstall --into {other}") == (f"Removed {other}/ros2\n", "", 0)
    assert (folder / "ros2").exists()
