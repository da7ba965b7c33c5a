"""The commands of docs/camera.md are typed in their order, in one folder.

Their outputs have the shown shape.
"""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import WAIT_S, Daemon
from pages import ROOT, Start
from tutorials import Tutorial

pytestmark = pytest.mark.landing

PAGE = (ROOT / "docs" / "camera.md").read_text()
HOME = "/home/you"
EXACT = ("area: 1600", "area: 3200", "largest: 3200", "Integer value is: 100")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's home, with the folder of the project."""
    home = tmp_path / "home"
    project = home / "camera"
    project.mkdir(parents=True)
    for name in ("XDG_CONFIG_HOME", "ROS_HOME", "ROS_LOG_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.chdir(project)
    return home


def test_all_that_is_shown(daemon: Daemon, home: Path, start: Start, tmp_path: Path) -> None:
    pytest.importorskip("numpy")
    (tmp_path / "busd").mkdir(mode=0o700)
    (tmp_path / "busd" / "0.sock").symlink_to(daemon.path)  # the command finds a running busd
    typed = {"python -m pytest": "python -m pytest -p no:cacheprovider"}
    text = PAGE.replace(HOME, str(home))
    Tutorial(text, home / "camera", start, exact=EXACT, typed=typed).run()
    if shutil.which("systemd-analyze"):
        verify(home)


def verify(home: Path) -> None:
    """systemd accepts the unit of the page, together with the units of busd."""
    python = home / "camera" / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.symlink_to(sys.executable)
    units = home / ".config" / "systemd" / "user"
    shutil.copy(home / "camera" / "camera@.service", units)
    command = ["systemd-analyze", "--user", "verify", str(units / "camera@.service")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=False)
    assert (done.returncode, done.stderr) == (0, "")
