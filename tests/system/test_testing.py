"""The pytest plugin for users, run as they run it: with the page's example and with wrong tests."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import TEST_S
from pages import ROOT, SCRIPT

EXAMPLE = dict(SCRIPT.findall((ROOT / "docs" / "testing.md").read_text()))
SERVER = dict(SCRIPT.findall((ROOT / "docs" / "patterns.md").read_text()))["web.py"]

WRONG = """\
import subprocess, sys
import bus
from bus.msg.std_msgs import String

left = []

def test_a_node_of_this_process(bus_domain):
    left.append(bus.connect("camera"))
    left[0].create_publisher(String, "image")
    left[0].create_subscription(String, "commands")

def test_a_program(bus_domain):
    command = [sys.executable, "-m", "bus_cli", "topic", "pub", "/talk", "std_msgs/msg/String", "data: hi"]
    left.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
    with bus.connect("ear") as ear:
        ear.wait_for_message(String, "talk", timeout=60)

async def test_a_node_on_asyncio(bus_domain):
    left.append(bus.Node("driver"))
    await left[-1].open()

def test_one_that_fails_is_told_no_more(bus_domain):
    left.append(bus.connect("failed"))
    raise LookupError("of its own")

def test_busd_has_gone(bus_domain):
    with bus.connect("survivor"):
        bus_domain.kill()

def test_the_next_one_has_a_bus_of_its_own(bus_node, bus_domain):
    assert [node.full_name for node in bus_domain.graph().nodes] == ["/test"]

def test_the_programs_end():
    left[1].kill()
    left[1].wait()
"""

WITHOUT_BUSD = """\
import pytest, bus.testing

@pytest.fixture
def bus_domain():
    with bus.testing.Domain('--config', 'busd.toml') as domain:
        yield domain

def test_it(bus_node):
    pass
"""


def run_pytest(folder: Path, *options: str) -> str:
    """The output of pytest."""
    environ = {name: value for name, value in os.environ.items() if not name.startswith(("BUS", "PYTEST"))}
    environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"  # the other plugins of this environment start slowly
    plugins = ("-p", "pytest_asyncio.plugin", "-p", "xdist.plugin", "-p", "no:cacheprovider")
    options = (*plugins, "-o", "asyncio_mode=auto", "--rootdir", str(folder), *options)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options],
        cwd=folder,
        env={**environ, "TMPDIR": str(folder), "PYTHONDONTWRITEBYTECODE": "1"},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=TEST_S,
        check=False,
    )
    assert not list(folder.glob("bus-*")), "the folders of busd are left"
    return done.stdout


@pytest.mark.landing
@pytest.mark.parametrize("workers", ["0", pytest.param("2", marks=pytest.mark.nightly)])
def test_the_example_of_the_page(tmp_path: Path, workers: str) -> None:
    """Workers of pytest-xdist have their own buses, as each test has."""
    pytest.importorskip("httpx2", reason="FastAPI's TestClient needs httpx2: make setup installs it")
    for name, text in EXAMPLE.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "web.py").write_text(SERVER)
    assert set(EXAMPLE) == {"shouter.py", "test_shouter.py", "test_web.py", "conftest.py"}
    said = run_pytest(tmp_path, "-n", workers)
    assert re.search(r"^=+ 5 passed in ", said, re.MULTILINE), said


@pytest.fixture(scope="module")
def said_of_mistakes(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The output of pytest with wrong tests, and with a busd that can't start."""
    folder = tmp_path_factory.mktemp("mistakes")
    (folder / "conftest.py").write_text(EXAMPLE["conftest.py"])
    (folder / "test_wrong.py").write_text(WRONG)
    (folder / "busd.toml").write_text("[limits]\nnothing = 1\n")
    (folder / "test_without_busd.py").write_text(WITHOUT_BUSD)
    return run_pytest(folder, "-rA")


def test_what_is_left_is_named(said_of_mistakes: str) -> None:
    said = said_of_mistakes
    assert re.search(r"^=+ 1 failed, 6 passed.*, 4 errors in ", said, re.MULTILINE), said
    assert "  /camera of this process: publishes /image, subscribes to /commands\n" in said
    assert "  /driver of this process\n" in said
    program = r"^  /_bus_cli_\d+ of process \d+ \(\S+ -m bus_cli topic pub /talk .*\): publishes /talk$"
    assert re.search(program, said, re.MULTILINE), said
    assert "/failed of this process" not in said


def test_a_busd_that_can_not_start_says_why(said_of_mistakes: str) -> None:
    why = "BrokerUnavailable: busd could not be started for a test: .*busd.toml.*nothing"
    assert re.search(why, said_of_mistakes), said_of_mistakes


def test_nothing_of_the_library_needs_pytest() -> None:
    text = "import sys, bus; [getattr(bus, name) for name in bus.__all__]; print('pytest' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", text], text=True, stdout=subprocess.PIPE, check=True).stdout
    assert said == "False\n"
