"""launch_testing.launch_test: the error for a file that can't be run."""

import sys
from pathlib import Path

import pytest

from bus_launch.launch_testing.launch_test import main


def test_a_file_that_needs_pytest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "test_it.py"
    path.write_text("import pytest\n")
    monkeypatch.setitem(sys.modules, "pytest", None)
    assert main([str(path)]) == 1
    assert capsys.readouterr().err.splitlines()[-1] == "the file needs pytest: pip install pytest"
