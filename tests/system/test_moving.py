"""Programs of docs/moving.md: busd's are run in pairs, others if their packages are there."""

import signal
from pathlib import Path

import pytest

from pages import FILE, ROOT, Start, check, console

PAGE = (ROOT / "docs" / "moving.md").read_text()
SCRIPTS = dict(FILE.findall(PAGE))
RIVALS = {name: name.partition("_")[0] for name in SCRIPTS if name.startswith(("zmq_", "redis_"))}
"""Programs for other systems, by the module that they need."""

_RUNS = console(PAGE)
PARTNERS = {_RUNS[at + 1].command: run.command for at, run in enumerate(_RUNS) if run.command.endswith("&")}
"""The command that a page starts in the background, by the one after it."""
SHOWN = {run.command: run for run in _RUNS if not run.command.endswith("&")}

pytestmark = pytest.mark.usefixtures("daemon")


def test_every_program_is_run_or_is_a_rival_s() -> None:
    run = {
        command.split()[-1] for command in [*SHOWN, *(one.removesuffix(" &") for one in PARTNERS.values())]
    }
    assert run | set(RIVALS) == set(SCRIPTS)
    for name in RIVALS:
        compile(SCRIPTS[name], name, "exec")


@pytest.mark.parametrize("command", SHOWN)
def test_prints_what_is_shown(command: str, tmp_path: Path, start: Start) -> None:
    for name, text in SCRIPTS.items():
        (tmp_path / name).write_text(text)
    if partner := PARTNERS.get(command):
        start(partner.removesuffix(" &"), tmp_path)
    program = start(command, tmp_path)
    check(program, SHOWN[command])
    if SHOWN[command].is_interrupted:
        program.end(signal.SIGINT)
        assert "Traceback" not in program.text


def test_a_publisher_and_a_subscriber_of_pyzmq(tmp_path: Path, start: Start) -> None:
    pytest.importorskip("zmq")
    for name in ("zmq_publisher.py", "zmq_subscriber.py"):
        (tmp_path / name).write_text(SCRIPTS[name].replace("/tmp/", f"{tmp_path}/"))
    start("python zmq_publisher.py", tmp_path)
    check(start("python zmq_subscriber.py", tmp_path), SHOWN["python subscriber.py"])
