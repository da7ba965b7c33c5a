"""busd.process.restart: the command and environment of the next busd, and the check that it can start."""

import sys
from pathlib import Path

import pytest

from busd.process import restart
from busd.process.restart import CHECK, command_line, find_fault


def program(source: str) -> list[str]:
    return [sys.executable, "-c", source]


async def test_nothing_is_wrong() -> None:
    assert await find_fault(program(f"import sys; sys.exit(sys.argv[1:] != [{CHECK!r}])")) == ""


@pytest.mark.parametrize(
    ("source", "fault"),
    [
        ("import sys; sys.exit('a warning\\nbusd: no such file')", "no such file"),
        ("raise SystemExit(7)", "the new busd ended with 7"),
        ("import nonsense_of_a_test", "ModuleNotFoundError: No module named 'nonsense_of_a_test'"),
    ],
)
async def test_what_is_wrong_is_one_line(source: str, fault: str) -> None:
    assert await find_fault(program(source)) == fault


async def test_no_such_program(tmp_path: Path) -> None:
    path = str(tmp_path / "python")
    assert await find_fault([path, "-m", "busd"]) == f"{path}: No such file or directory"


async def test_one_that_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(restart, "_CHECK_S", 0.1)
    fault = await find_fault(program("import signal; signal.pause()"))
    assert fault == "the new busd does not come up within 0.1 s"


def test_the_same_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "orig_argv", ["python", "-I", "/somewhere/bin/busd", "--domain", "7"])
    assert command_line(None) == [sys.executable, "-I", "/somewhere/bin/busd", "--domain", "7"]
    assert command_line(["--domain", "7"]) == [sys.executable, "-m", "busd", "--domain", "7"]
