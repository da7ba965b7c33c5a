"""Behaviour common to all verbs of `bus`; and `bus daemon`, `bus doctor` and completion."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from bus import Durability, QoSProfile, connect
from bus.types.classes import message_class
from cli import BUS, LISTENER, TALKER, Result, bus, script, start, without_hint
from conftest import WAIT_S


@pytest.mark.parametrize(
    ("verb", "number"),
    [
        ("echo", signal.SIGINT),
        ("echo", signal.SIGTERM),
        ("hz", signal.SIGINT),
        ("pub", signal.SIGTERM),
        *(
            pytest.param(verb, number, marks=pytest.mark.nightly)
            for verb, number in [
                ("hz", signal.SIGTERM),
                ("bw", signal.SIGINT),
                ("bw", signal.SIGTERM),
                ("delay", signal.SIGINT),
                ("delay", signal.SIGTERM),
                ("pub", signal.SIGINT),
            ]
        ),
    ],
)
def test_signals_end_every_verb_that_stays(daemon: object, verb: str, number: signal.Signals) -> None:
    words = (
        ["topic", verb, "/topic", "std_msgs/msg/String"]
        if verb in ("echo", "pub")
        else ["topic", verb, "/topic"]
    )
    with start(*words, is_fresh=True) as running:
        # Each verb prints a line once it runs: the reason for its silence, or the message that it publishes.
        running.line() if verb == "pub" else running.error_line()
        result = running.end(number)
    assert result.code == -number
    assert "Traceback" not in result.err


def test_a_reader_that_has_seen_enough_is_no_error(daemon: object) -> None:
    shell = f"{sys.executable} -m bus_cli topic echo /topic; echo $? >&2"
    with script(TALKER, "0.05"):
        done = subprocess.run(
            ["bash", "-c", f"({shell}) | head -1"], capture_output=True, text=True, timeout=WAIT_S
        )
    assert done.stdout.startswith("data: 'Hello World: ")
    assert without_hint(Result(done.stdout, done.stderr, 0)).err == "0\n"


@pytest.mark.parametrize("verb", ["echo", "hz", "bw", "delay", "top"])
def test_a_reader_that_goes_ends_who_only_prints(daemon: object, verb: str) -> None:
    """They end at once, not at the next line of output, which may be an hour away."""
    words = ("top", "--json", "-d", "3600") if verb == "top" else ("topic", verb, "/topic")
    with (
        script(TALKER, "1000"),
        subprocess.Popen((*BUS, *words), stdout=subprocess.PIPE, stderr=subprocess.PIPE) as running,
    ):
        assert running.stdout is not None
        assert running.stderr is not None
        if verb == "echo":
            assert b"no message yet on '/topic'" in running.stderr.readline()
        running.stdout.close()
        assert running.wait(WAIT_S) == 0
        assert running.stderr.read() == b""


def test_output_to_a_closed_pipe(daemon: object) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run((*BUS, "topic", "--help"), stdout=writer, stderr=subprocess.PIPE, timeout=WAIT_S)
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, b"")


def test_without_a_place_for_output(daemon: object) -> None:
    shell = f"{sys.executable} -m bus_cli topic list"
    for closed, said in ((">&-", ""), ("2>&-", "/rosout\n"), ("<&- >&- 2>&-", "")):
        with script(TALKER, "0.05"):
            done = subprocess.run(
                ["bash", "-c", f"{shell} {closed}"], capture_output=True, text=True, timeout=WAIT_S
            )
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.startswith(said) and bool(done.stdout) is bool(said)


def test_what_asks_one_thing_imports_no_event_loop(daemon: object) -> None:
    with script(TALKER, "1000"):
        for words in (
            "topic list",
            "topic info -v /rosout",
            "topic find std_msgs/msg/String",
            "topic type /rosout",
            "node list",
            "node info /minimal_publisher",
            "daemon status",
        ):
            command = (sys.executable, "-X", "importtime", "-m", "bus_cli", *words.split())
            done = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S)
            assert done.returncode == 0, done.stdout
            imported = {
                line.rpartition("|")[2].strip().partition(".")[0] for line in done.stderr.splitlines()
            }
            assert "msgspec" in imported, words
            assert not imported & {"asyncio", "uvloop", "yaml"}, words


def test_a_daemon_is_started_where_none_runs(socket_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("BUSD_AUTOSTART")
    assert bus("topic", "list") == Result("", "", 0)
    assert socket_path.is_socket()
    assert bus("daemon", "stop") == Result("The daemon has been stopped\n", "", 0)


def test_daemon_start_status_stop(socket_path: Path) -> None:
    assert bus("daemon", "status") == Result("The daemon is not running\n", "", 1)
    assert bus("daemon", "start") == Result("The daemon has been started\n", "", 0)
    try:
        assert bus("daemon", "start") == Result("The daemon is already running\n", "", 0)
        assert bus("daemon", "status") == Result("The daemon is running\n", "", 0)
        status = bus("daemon", "status", "--json")
        assert re.fullmatch(rf'{{"running":true,"pid":\d+,"socket":"{socket_path}"}}\n', status.out)
    finally:
        stopped = bus("daemon", "stop")
    assert stopped == Result("The daemon has been stopped\n", "", 0)
    assert not socket_path.exists()
    assert bus("daemon", "stop") == Result("The daemon is not running\n", "", 0)
    assert (
        bus("daemon", "status", "--json").out == f'{{"running":false,"pid":null,"socket":"{socket_path}"}}\n'
    )


def test_a_started_daemon_has_no_idle_exit_and_takes_a_configuration(socket_path: Path) -> None:
    config = socket_path.with_name("busd.toml")
    config.write_text("[limits]\nnodes_per_peer = 0x\n")
    failed = bus("daemon", "start", "--config", str(config))
    assert failed.code == 1
    assert failed.err.startswith(f"busd could not be started at {socket_path}: ")
    config.write_text("")
    started = bus("daemon", "start", "--json", "--config", str(config), "--log-level", "debug")
    try:
        (pid,) = re.findall(r'"pid":(\d+)', started.out)
        command = Path(f"/proc/{pid}/cmdline").read_bytes()
        assert b"--idle-exit" not in command
        assert f"--config={config}".encode() in command
    finally:
        bus("daemon", "stop")


def test_no_daemon_and_none_may_be_started(socket_path: Path) -> None:
    for words in (("topic", "list"), ("topic", "echo", "/x"), ("node", "info", "/x")):
        failed = bus(*words)
        assert (failed.out, failed.code) == ("", 1)
        assert failed.err.startswith(f"no busd listens on {socket_path}; start one with: busd --socket")


def test_doctor_on_a_system_that_works(daemon: Any) -> None:
    result = bus("doctor")
    assert result.code == 0
    assert re.search(
        rf"^\[ ok \] daemon: pid {daemon.pid}, protocol 1, 0 nodes, up 0 h 0 min ", result.out, re.M
    )
    assert "[fail]" not in result.out


def test_doctor_says_whether_memory_is_shared(socket_path: Path, route: str) -> None:
    shown = {
        "shm": "[ ok ] shared memory: used between processes of one user\n",
        "socket": "[warn] shared memory: not used: BUS_ROUTE=socket is set; messages go through busd\n"
        "       -> unset BUS_ROUTE\n",
    }
    assert shown[route] in bus("doctor").out


def test_topic_info_shows_the_route_of_each_match(daemon: object, route: str) -> None:
    with script(LISTENER), script(TALKER, "1000"):
        text = bus("topic", "info", "-v", "/topic").out
    assert f"Matches: 1\n  /minimal_subscriber (route: {route})\n" in text
    assert f"Matches: 1\n  /minimal_publisher (route: {route})\n" in text


def complete(line: str, tmp_path: Path) -> list[str]:
    """The completions of argcomplete for a command line, by its protocol (descriptor 8 takes the answer)."""
    answer = tmp_path / "answer"
    environ = {
        **os.environ,
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(answer),
        "_ARGCOMPLETE_IFS": "\n",
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
        "COMP_TYPE": "9",
    }
    subprocess.run(BUS, env=environ, capture_output=True, timeout=WAIT_S, check=True)
    return [word.strip() for word in answer.read_text().splitlines()]


def test_the_shell_completes_from_the_live_graph(daemon: object, tmp_path: Path) -> None:
    pytest.importorskip("argcomplete")
    with script(TALKER, "1"):
        assert complete("bus topic ec", tmp_path) == ["echo"]
        assert complete("bus topic echo /t", tmp_path) == ["/topic"]
        offered = complete("bus topic echo /topic ", tmp_path)
        assert [word for word in offered if not word.startswith("-")] == ["std_msgs/msg/String"]
        assert complete("bus top --sort lo", tmp_path) == ["lost/s", "lost"]
        assert complete("bus bag record /t", tmp_path) == ["/topic"]
        assert complete("bus bag record --topics /t", tmp_path) == ["/topic"]
        assert complete("bus node info /m", tmp_path) == ["/minimal_publisher"]
        assert complete("bus topic find std_msgs/msg/Str", tmp_path) == ["std_msgs/msg/String"]
        assert "--once" in complete("bus topic echo --on", tmp_path)


def offered(line: str, tmp_path: Path) -> list[str]:
    return [word for word in complete(line, tmp_path) if not word.startswith("-")]


def test_the_shell_completes_launch_files_and_programs(tmp_path: Path) -> None:
    pytest.importorskip("argcomplete")
    assert offered("bus launch turtlesim ", tmp_path) == ["multisim.launch.py"]
    assert offered("bus run turtlesim mi", tmp_path) == ["mimic"]


def test_the_shell_completes_bags(tmp_path: Path) -> None:
    pytest.importorskip("argcomplete")
    (tmp_path / "walk").mkdir()
    for verb in ("play", "burst", "info", "reindex"):
        assert complete(f"bus bag {verb} {tmp_path}/wa", tmp_path) == [f"{tmp_path}/walk/"]
    assert complete("bus bag play --skip", tmp_path) == ["--skip-gaps"]


def test_the_shell_completes_frames(daemon: object, tmp_path: Path) -> None:
    pytest.importorskip("argcomplete")
    with connect("frames") as node:
        kind = message_class("tf2_msgs/msg/TFMessage")
        latched = QoSProfile(1, durability=Durability.TRANSIENT_LOCAL)
        publisher = node.create_publisher(kind, "/tf_static", latched)
        message: Any = kind()
        message.transforms.append(message_class("geometry_msgs/msg/TransformStamped")())
        message.transforms[0].header.frame_id = "world"
        message.transforms[0].child_frame_id = "robot"
        publisher.publish(message)
        assert offered("bus tf2 echo ", tmp_path) == ["robot", "world"]


def test_completion_starts_no_daemon(
    socket_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("argcomplete")
    monkeypatch.delenv("BUSD_AUTOSTART")
    complete("bus topic echo /t", tmp_path)
    assert not socket_path.exists()


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_completion_code_can_be_evaluated(shell: str) -> None:
    pytest.importorskip("argcomplete")
    result = bus("completion", shell)
    assert result.code == 0
    assert "bus" in result.out
    if shell == "bash":
        subprocess.run(["bash", "-c", result.out], check=True, timeout=WAIT_S)
