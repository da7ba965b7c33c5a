"""bus_launch.launch.logging: the forms of lines on the screen and in log files."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from bus_launch.launch import logging
from bus_launch.launch.logging import get_logger, launch_config


@pytest.fixture(autouse=True)
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))
    monkeypatch.delenv("OVERRIDE_LAUNCH_SCREEN_FORMAT", raising=False)
    monkeypatch.delenv("OVERRIDE_LAUNCH_LOG_FORMAT", raising=False)
    logging.reset()
    yield
    monkeypatch.undo()
    logging.reset()


def log_file() -> str:
    return Path(launch_config.get_log_file_path()).read_text()


def test_named_forms_and_templates(capsys: pytest.CaptureFixture[str]) -> None:
    logger = get_logger("a")
    logger.info("one")
    launch_config.set_screen_format("default_with_timestamp")
    launch_config.set_log_format("%(name)s says %(message)s", log_style="%")
    logger.info("two")
    launch_config.set_screen_format("{name}: {message}")
    get_logger("b").info("three")
    first, second, third = capsys.readouterr().out.splitlines()
    assert (first, third) == ("[INFO] [a]: one", "b: three")
    assert re.fullmatch(r"\d+\.\d{7} \[INFO\] \[a\]: two", second)
    first, second, third = log_file().splitlines()
    assert re.fullmatch(r"\d+\.\d{7} \[INFO\] \[a\]: one", first)
    assert (second, third) == ("a says two", "b says three")


def test_variables_override_forms(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OVERRIDE_LAUNCH_SCREEN_FORMAT", "screen {message}")
    monkeypatch.setenv("OVERRIDE_LAUNCH_LOG_FORMAT", "file {message}")
    launch_config.reset()
    launch_config.set_screen_format("default")
    launch_config.set_log_format("%(message)s", log_style="%")
    get_logger("a").info("one")
    assert capsys.readouterr().out == "screen one\n"
    assert log_file() == "file one\n"


def test_a_named_form_has_its_style() -> None:
    for set_form in (
        lambda: launch_config.set_screen_format("default", screen_style="%"),
        lambda: launch_config.set_log_format("default", log_style="{"),
    ):
        with pytest.raises(ValueError, match="the format 'default' has a style of its own"):
            set_form()
