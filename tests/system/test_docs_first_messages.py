"""The commands of docs/first-messages.md are typed in their order, in one folder.

Their outputs have the shown shape.
"""

from importlib.util import find_spec
from pathlib import Path

import pytest

from bus import shm
from pages import ROOT, Start
from ports import free_port
from tutorials import Tutorial

PAGE = (ROOT / "docs" / "first-messages.md").read_text()
NEEDS = {"bus bag ": "mcap", "bus web": "websockets"}
"""Packages of extras, by the commands that need them."""


def can_run(section: str) -> bool:
    return all(find_spec(package) for command, package in NEEDS.items() if f"$ {command}" in section)


@pytest.mark.usefixtures("daemon")
def test_all_that_is_shown(start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    page = PAGE if shm.is_available() else PAGE.replace("route: shm", "route: socket")
    typed = {
        "bus web": f"bus web --listen 127.0.0.1:{free_port()}",
        "bus topic echo --once": "bus topic echo --no-lost-messages --once",  # a busy machine loses some
    }
    meanwhile = {"bus bag record": "bus topic echo --once /temperature"}
    Tutorial(page, tmp_path, start, is_wanted=can_run, typed=typed, meanwhile=meanwhile).run()
