"""Programs of packages, by name and as child processes."""

import sys
from pathlib import Path

import pytest

from bus_ros.ros2run import api
from rows import for_each


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "lib" / "my_package"
    for name in ("talker", "a/listener", "b/listener"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch(0o755)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    return folder


def test_a_program_by_name(programs: Path) -> None:
    find = api.get_executable_path
    assert find(package_name="my_package", executable_name="talker") == str(programs / "talker")
    assert find(package_name="my_package", executable_name="nothing") is None
    with pytest.raises(api.MultipleExecutables) as caught:
        find(package_name="my_package", executable_name="listener")
    assert list(caught.value.paths) == [str(programs / "a/listener"), str(programs / "b/listener")]
    with pytest.raises(api.PackageNotFound):
        find(package_name="no_such_package", executable_name="talker")


@for_each(
    ("code", "status", "line"),
    [
        ("pass", 0, ""),
        ("raise SystemExit(3)", 3, "[ros2run]: Process exited with failure 3\n"),
        ("import os; os.kill(os.getpid(), 15)", -15, "[ros2run]: Terminated\n"),
    ],
)
def test_running_a_program(code: str, status: int, line: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert api.run_executable(path="-c", argv=[code], prefix=[sys.executable]) == status
    assert capsys.readouterr().out == line
