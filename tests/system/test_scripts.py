"""Every program on the page about scripts runs as a user would run it."""

from pathlib import Path

import pytest

from pages import ROOT, SCRIPT, Start, check, console

PAGE = (ROOT / "docs" / "scripts.md").read_text()
SCRIPTS = dict(SCRIPT.findall(PAGE))
SHOWN = {shown.command.split()[-1]: shown for shown in console(PAGE)}

pytestmark = pytest.mark.usefixtures("daemon")


@pytest.mark.parametrize("name", SHOWN)
def test_prints_what_is_shown(name: str, tmp_path: Path, start: Start) -> None:
    (tmp_path / name).write_text(SCRIPTS[name])
    check(start(SHOWN[name].command, tmp_path), SHOWN[name])


def test_one_speaks_and_one_listens(tmp_path: Path, start: Start) -> None:
    assert set(SCRIPTS) == {*SHOWN, "say.py", "hear.py"}
    for name in ("say.py", "hear.py"):
        (tmp_path / name).write_text(SCRIPTS[name])
    say = start("python say.py", tmp_path)  # first, because it waits longer than the other
    hear = start("python hear.py", tmp_path)
    assert (hear.end(), hear.text, say.end(), say.text) == (0, "hello\n", 0, "")
