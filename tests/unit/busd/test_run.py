"""busd.run: the command line."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

import bus
from busd.run import main


@pytest.fixture(autouse=True)
def signals() -> Iterator[None]:
    """`main` blocks the signals that end it. They stay blocked, because only the end of the process
    follows.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    yield
    signal.pthread_sigmask(signal.SIG_SETMASK, before)


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match=r"^0$"):
        main(["--version"])
    assert capsys.readouterr().out == f"busd {bus.__version__}\n"


@pytest.mark.parametrize("text", ["abc", "", "0", "-1", "nan", "inf"])
def test_an_idle_exit_is_a_number_of_seconds(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([f"--idle-exit={text}"])
    told = capsys.readouterr().err.splitlines()[-1]
    assert told == f"busd: error: argument --idle-exit: {text!r} is not a number of seconds above 0"


def test_a_look_at_the_configuration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The check opens nothing, so it is possible while busd runs."""
    config = tmp_path / "busd.toml"
    arguments = ["--socket", str(tmp_path / "s"), "--config", str(config), "--check"]
    config.write_text("[limits]\ndepth = 5\n")
    assert main(arguments) == 0
    config.write_text("[limits]\ndepth = 0\n")
    assert main(arguments) == 1
    assert capsys.readouterr().err == f"busd: {config}: limits.depth = 0: expected `int` >= 1\n"
    assert list(tmp_path.iterdir()) == [config]
