"""Nodes that a launch forks from a warm process behave like freshly started ones."""

import json
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from bus_launch import warm
from bus_launch.launch.actions import OpaqueFunction, RegisterEventHandler
from bus_launch.launch.core import LaunchContext
from bus_launch.launch.event_handlers import OnProcessExit, OnProcessStart
from bus_launch.launch_ros.actions import Node
from launching import run, write

LOOK = """
import gc, json, locale, os, random, signal, sys, threading
stat = open("/proc/self/status").read()
masks = [line for line in stat.splitlines() if line.startswith(("SigB", "SigI", "SigC", "ShdPnd", "Cap"))]
links = {fd: f"/proc/self/fd/{fd}" for fd in os.listdir("/proc/self/fd")}
kinds = {fd: os.readlink(link).partition(":")[0] for fd, link in links.items() if os.path.exists(link)}
kinds = {fd: kind.rstrip("0123456789") for fd, kind in kinds.items()}
streams = [sys.stdin, sys.stdout, sys.stderr]
mine = sys.argv[1]
strip = lambda words: [word for word in words if word != mine]
seen = {
    "is_forked": gc.get_freeze_count() > 0,
    "random": random.random(),
    "pid": os.getpid(),
    "same": {
        "argv": strip(sys.argv),
        "orig_argv": strip(sys.orig_argv),
        "cmdline": strip(open("/proc/self/cmdline").read().split("\\0")),
        "cwd": os.getcwd(),
        "environ": dict(os.environ),
        "path": sys.path,
        "flags": str(sys.flags),
        "main": sorted(vars()),
        "file": __file__,
        "is_leader": os.getpgid(0) == os.getpid(),
        "session": os.getsid(0),
        "parent": os.getppid(),
        "masks": masks,
        "handlers": {str(number): str(signal.getsignal(number)) for number in signal.valid_signals()},
        "threads": [thread.name for thread in threading.enumerate()],
        "fds": kinds,
        "streams": [(s.encoding, s.errors, s.line_buffering, s.isatty(), s.mode) for s in streams],
        "gc": (gc.isenabled(), gc.get_threshold()),
        "rclpy": "rclpy" in sys.modules,
        "locale": locale.setlocale(locale.LC_ALL),
    },
}
open(sys.argv[1], "w").write(json.dumps(seen))
END
"""


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))


def look(folder: Path, end: str = "") -> Path:
    """A program that writes down its environment, and then runs `end`."""
    return write(folder, {"look.py": LOOK.replace("END", end)}) / "look.py"


def node(program: Path, name: str, **more: Any) -> Node:
    return Node(executable=str(program), arguments=[str(program.with_name(name))], **more)


def one_after_the_other(first: Node, *others: Node) -> list[Any]:
    pairs = zip([first, *others], others, strict=False)
    return [*[RegisterEventHandler(OnProcessExit(target_action=a, on_exit=[b])) for a, b in pairs], first]


def found(program: Path, name: str) -> Any:
    return json.loads(program.with_name(name).read_text())


@pytest.mark.parametrize("emulate_tty", [False, True])
def test_a_forked_node_finds_what_a_started_one_does(tmp_path: Path, emulate_tty: bool) -> None:
    program = look(tmp_path)
    nodes = [node(program, f"{number}.json", emulate_tty=emulate_tty) for number in range(3)]
    assert run(*one_after_the_other(*nodes)) == 0
    seen = [found(program, f"{number}.json") for number in range(3)]
    assert [one["is_forked"] for one in seen] == [False, True, True]
    for one in seen[1:]:
        assert one["same"] == seen[0]["same"]
    assert len({one["random"] for one in seen}) == len({one["pid"] for one in seen}) == 3


def test_ends_of_forked_nodes(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Exit codes, signals and tracebacks equal those of a freshly started node."""
    end = "import os; print('here', flush=True); os.kill(os.getpid(), 9) if END2 else 1 / 0"
    program = look(tmp_path, end)
    text = program.read_text().replace("END2", "sys.argv[1].endswith('killed')")
    program.write_text(text)
    nodes = [node(program, name, output="screen") for name in ("0", "1", "killed")]
    assert run(*one_after_the_other(*nodes)) == 0
    assert [one.return_code for one in nodes] == [1, 1, -signal.SIGKILL]
    assert [found(program, name)["is_forked"] for name in ("0", "1", "killed")] == [False, True, True]
    out, _ = capfd.readouterr()
    written = [
        [line.partition("] ")[2] for line in out.splitlines() if line.startswith(f"[{one.name}]")]
        for one in nodes
    ]
    assert written[2] == ["here"]
    for lines in written[:2]:
        lines.remove("here")  # stdout, which may be read before or after stderr
    assert written[0] == written[1]
    assert written[0][-1] == "ZeroDivisionError: division by zero"


def test_which_are_started_anew(tmp_path: Path) -> None:
    """Nodes with their own environment, folder or prefix."""
    program = look(tmp_path)
    nodes = [
        node(program, "0"),
        node(program, "1"),
        node(program, "2", additional_env={"MINE": "1"}),
        node(program, "3", cwd=str(tmp_path)),
        node(program, "4", prefix="nice"),
        node(program, "5"),
    ]
    assert run(*one_after_the_other(*nodes)) == 0
    seen = [found(program, str(number)) for number in range(6)]
    assert [one["is_forked"] for one in seen] == [False, True, False, False, False, True]
    assert seen[2]["same"]["environ"]["MINE"] == "1"
    assert seen[3]["same"]["cwd"] == str(tmp_path)


def test_nodes_outlive_the_warm_process(tmp_path: Path) -> None:
    """If it is killed, its nodes continue, and later nodes are started without it."""
    program = look(tmp_path, "import sys; sys.argv[1].endswith('1') and sys.stdin.read()")
    nodes = [node(program, str(number)) for number in range(3)]

    def kill(context: LaunchContext) -> None:
        assert warm._warm is not None and warm._warm._process is not None
        os.kill(warm._warm._process.pid, signal.SIGKILL)
        warm._warm._process.wait()

    def end(context: LaunchContext) -> None:
        assert nodes[1].return_code is None
        assert nodes[1].process_details is not None
        os.kill(nodes[1].process_details["pid"], signal.SIGTERM)

    code = run(
        RegisterEventHandler(
            OnProcessStart(target_action=nodes[1], on_start=[OpaqueFunction(function=kill), nodes[2]])
        ),
        RegisterEventHandler(OnProcessExit(target_action=nodes[2], on_exit=OpaqueFunction(function=end))),
        *nodes[:2],
    )
    assert code == 0
    assert [one.return_code for one in nodes] == [0, -signal.SIGTERM, 0]
    assert not found(program, "2")["is_forked"]
