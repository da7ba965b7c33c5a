"""The finding of `bus doctor` about programs named `ros2`."""

import sys
from pathlib import Path

from bus_cli.doctor.finding import Finding
from bus_cli.doctor.versions import ros2_program
from bus_cli.ros2.script import script_text


def program(folder: Path, text: str) -> str:
    folder.mkdir()
    path = folder / "ros2"
    path.write_text(text)
    path.chmod(0o755)
    return str(folder)


def test_the_ros2_in_path(tmp_path: Path) -> None:
    ours = program(tmp_path / "env", script_text(sys.executable))
    other = program(tmp_path / "opt", "#!/usr/bin/python3\n")
    assert list(ros2_program([str(tmp_path), other])) == []
    assert list(ros2_program([str(tmp_path), ours])) == [Finding("ok", "ros2", f"{ours}/ros2 runs bus")]
    for first, second in ((ours, other), (other, ours)):
        text = f"{first}/ros2 comes before the others in PATH: {ours}/ros2 is busd's, {other}/ros2 is not"
        assert list(ros2_program([first, second])) == [
            Finding("warn", "ros2", text, f"bus ros2 uninstall --into {ours}")
        ]
