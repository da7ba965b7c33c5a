"""Every program on the pages about patterns, any type and CDR runs as a user would run it."""

import ast
import inspect
import signal
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import pytest

from conftest import WAIT_S, Daemon
from pages import BLOCK, FILE, ROOT, Start, check, console
from ports import free_port

PAGE = "".join((ROOT / "docs" / name).read_text() for name in ("patterns.md", "any-type.md", "cdr.md"))
SCRIPTS = dict(FILE.findall(PAGE))
COMMANDS = console(PAGE)
SHOWN = {shown.command.split()[-1]: shown for shown in COMMANDS if "pytest" not in shown.command}
TESTS = ("conftest.py", "pytest.ini", "test_limiter.py")
SERVERS = {
    "web.py": "python -m uvicorn web:app --port {port}",
    "web_aiohttp.py": "python web_aiohttp.py",
}
PORT = 8000
"""The port on the page; tests run side by side and use others."""

pytestmark = pytest.mark.usefixtures("daemon")


def test_every_program_is_run() -> None:
    assert set(SCRIPTS) == set(SHOWN) | set(SERVERS) | {*TESTS}


@pytest.mark.parametrize("name", SHOWN)
def test_prints_what_is_shown(name: str, tmp_path: Path, start: Start) -> None:
    shown = SHOWN[name]
    (tmp_path / name).write_text(SCRIPTS[name])
    program = start(shown.command, tmp_path)
    check(program, shown)
    if shown.is_interrupted:
        program.end(signal.SIGINT)
        assert tuple(program.text.splitlines()[len(shown.output) :]) == shown.farewell


def test_in_pytest(tmp_path: Path, start: Start) -> None:
    (shown,) = [one for one in COMMANDS if "pytest" in one.command]
    for name in TESTS:
        (tmp_path / name).write_text(SCRIPTS[name])
    check(start(f"{shown.command} -p no:cacheprovider", tmp_path), shown)


def ask(url: str, method: str = "GET") -> str:
    """The first answer of a server that is still starting."""
    until = time.monotonic() + WAIT_S
    while True:
        try:
            with urllib.request.urlopen(urllib.request.Request(url, method=method), timeout=WAIT_S) as answer:
                text: str = answer.read().decode()
                return text
        except urllib.error.URLError:
            assert time.monotonic() < until, url
            time.sleep(0.05)


@pytest.mark.parametrize("name", SERVERS)
def test_a_node_in_a_web_server(name: str, tmp_path: Path, start: Start) -> None:
    pytest.importorskip("uvicorn" if name == "web.py" else "aiohttp")
    port = free_port()
    (tmp_path / name).write_text(SCRIPTS[name].replace(str(PORT), str(port)))
    server = start(SERVERS[name].format(port=port), tmp_path)
    url = f"http://127.0.0.1:{port}/words"
    said = ask(f"{url}/hi", "POST")
    if name == "web.py":
        while ask(url) != '["hi"]':
            time.sleep(0.01)
    else:
        assert said == "0 heard it"
    server.end(signal.SIGINT)
    assert "Traceback" not in server.text and "ERROR" not in server.text


async def test_the_cells_of_a_notebook(daemon: Daemon) -> None:
    """As a kernel runs them: one after the other in one event loop, with `await` allowed in each."""
    cells = [text for language, text in BLOCK.findall(PAGE) if language == "jupyter"]
    names: dict[str, Any] = {}
    for cell in cells:
        result = eval(compile(cell, "<cell>", "exec", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT), names)
        if inspect.isawaitable(result):
            await result
    assert names["message"].data == "from a cell"
