"""`bus doctor` with a fault in a real busd or in a program on it."""

import os
import re
import signal
from pathlib import Path

import msgspec
import pytest

from bus_cli.doctor import daemon as module
from bus_cli.query import Query
from cli import LISTENER, bus, script
from conftest import Daemon
from neighbours import wait_until


def is_stopped(pid: int) -> bool:
    """Stopped by a signal, according to the kernel."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].startswith("T")


def test_a_daemon_that_is_stopped(daemon: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    """It reports that, and waits no longer than necessary: a later answer would not help."""
    os.kill(daemon.pid, signal.SIGSTOP)
    wait_until(lambda: is_stopped(daemon.pid))
    monkeypatch.setattr(module, "_ANSWER_S", 0.1)
    silence = module.reach(daemon.path)
    assert "does not answer" in str(silence)
    (found,) = module.examine(daemon.path, silence)
    assert found.text == f"pid {daemon.pid} is stopped (SIGSTOP, Ctrl-Z or a debugger)"
    assert found.advice == f"kill -CONT {daemon.pid}"


def test_a_program_that_is_stopped(daemon: Daemon) -> None:
    with script(LISTENER) as listener:
        pid = listener.process.pid
        assert "1 with nodes; all run, none is near a limit" in bus("doctor").out
        os.kill(pid, signal.SIGSTOP)
        wait_until(lambda: is_stopped(pid))
        result = bus("doctor")
    assert f"(pid {pid}) (/minimal_subscriber) is stopped (SIGSTOP, Ctrl-Z or a debugger)" in result.out
    assert f"-> kill -CONT {pid}, or fg in its terminal\n" in result.out
    assert result.code == 0  # the other programs can work


@pytest.mark.parametrize("settings", ["[limits]\nendpoints_per_peer = 2\n"])
def test_a_program_at_its_limit(daemon: Daemon, settings: str) -> None:
    with script(LISTENER) as listener:
        out = bus("doctor").out
    assert f"(pid {listener.process.pid}) has 2 of 2 endpoints\n" in out
    assert "-> raise limits.endpoints_per_peer in busd.toml" in out


def test_a_daemon_whose_socket_is_gone(daemon: Daemon, tmp_path: Path) -> None:
    """No program can ever find it again; only the kernel still knows its socket."""
    with Query(daemon.path):  # busd answers: it does nothing more with the file
        daemon.path.unlink()
    text = f"[warn] other daemons: busd (pid {daemon.pid}) listens on {daemon.path}, which is gone"
    assert text in bus("doctor", "--socket", str(tmp_path / "other.sock")).out


def test_a_daemon_in_a_terminal_writes_no_log_file(daemon: Daemon) -> None:
    """So a file with the name of a log does no harm: perhaps its user sends its output there."""
    daemon.path.with_suffix(".log").write_text("busd 0.1.0")
    assert "] log: " not in bus("doctor", "-ep").out


MISMATCH = """
import asyncio, bus
from bus.msg.std_msgs import String
async def main():
    async with bus.Node("talker") as talker, bus.Node("listener") as listener:
        await talker.create_publisher(String, "topic", bus.QoSProfile(depth=1, reliability="best_effort"))
        await listener.create_subscription(String, "topic", 10, lambda message: None)
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""
REASON = "ERROR: Best effort publisher and reliable subscription"


def test_endpoints_that_do_not_match(daemon: Daemon) -> None:
    with script(MISMATCH):
        result, strict = bus("doctor"), bus("doctor", "--include-warnings", "-rf")
        excluded = bus("doctor", "-ep")
    assert f"[warn] topics: /topic: /talker and /listener do not match: {REASON}\n" in result.out
    assert "       -> bus topic info -v /topic\n" in result.out
    assert re.search(r"\n\nAll \d+ checks passed\n\n\Z", result.out)
    assert result.code == 0
    assert re.search(r"\n\n\d+/\d+ check\(s\) failed\n\nFailed modules: .*\btopics\b", strict.out)
    assert f"compatibility status    : {REASON}\n" in strict.out
    assert strict.code == 1
    assert "] msgspec: " in result.out
    assert "] msgspec: " not in excluded.out


def test_reports(daemon: Daemon) -> None:
    with script(LISTENER):
        result = bus("wtf", "--report")
        records = [
            msgspec.json.decode(line) for line in bus("doctor", "-r", "-ep", "--json").out.splitlines()
        ]
    assert result.code == 0
    assert "\n   TOPIC LIST\ntopic               : /topic\npublisher count     : 0\n" in result.out
    assert f"daemon             : pid {daemon.pid}\n" in result.out
    assert [record["report"] for record in records] == [
        "RMW MIDDLEWARE",
        "PLATFORM INFORMATION",
        "TOPIC LIST",
        "QOS COMPATIBILITY LIST",
    ]
    assert {"name": "subscriber count", "value": 1} in records[2]["items"]
    both = bus("doctor", "-r", "-rf")
    assert (both.out, both.code) == ("", 2)
