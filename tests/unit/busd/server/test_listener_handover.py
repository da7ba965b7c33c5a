"""busd.server.listener: the things that a program hands over to the next program in its process."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import WAIT_S

FIRST = """
import os, sys
from pathlib import Path
from busd.server.listener import open_listener
path = Path(sys.argv[1])
listener = open_listener(path, environ={})
print(os.getpid(), path.stat().st_ino, flush=True)
exec(sys.argv[3])
environ = {**os.environ, **listener.bequeath()}
os.execve(sys.executable, [sys.executable, "-c", sys.argv[4], sys.argv[2]], environ)
"""

SECOND = """
import os, sys
from pathlib import Path
from busd.server.listener import open_listener
def link(number):
    try:
        return os.readlink(f"/proc/self/fd/{number}")
    except OSError:
        return ""
def look():
    links = [link(number) for number in range(3, 64)]
    return sum(one.startswith("socket:") or one.partition(" ")[0].endswith(".lock") for one in links)
path = Path(sys.argv[1])
with open_listener(path) as listener:
    lock = path.with_name(path.name + ".lock")
    print(os.getpid(), path.stat().st_ino, listener.path == path, look())
    print(lock.read_text().strip(), [name for name in os.environ if "HANDOVER" in name])
    print([number for number in range(3, 64) if link(number) and os.get_inheritable(number)])
print(path.exists(), lock.exists(), look())
"""


def hand_over(path: Path, then: Path, meanwhile: str = "") -> list[list[str]]:
    """The output of both programs: lines of words."""
    done = subprocess.run(
        [sys.executable, "-c", FIRST, str(path), str(then), meanwhile, SECOND],
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [line.split() for line in done.stdout.splitlines()]


def test_socket_and_lock_go_on(tmp_path: Path) -> None:
    path = tmp_path / "s"
    first, second, lock, inheritable, after = hand_over(path, path)
    pid, _ = first
    assert second == [*first, "True", "2"]  # the same file, and no descriptor is open twice
    assert lock == [pid, "[]"]
    assert inheritable == ["[]"]
    assert after == ["False", "False", "0"]
    assert list(tmp_path.iterdir()) == []


def test_of_another_path_nothing_is_kept(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    _, second, *_ = hand_over(tmp_path / "s", tmp_path / "other" / "s")
    assert second[2:] == ["True", "2"]


@pytest.mark.parametrize("gone", ["s", "s.lock"])
def test_what_is_not_in_place_any_more_is_made_anew(tmp_path: Path, gone: str) -> None:
    """For example, a program that cleans /tmp removed it."""
    path = tmp_path / "s"
    meanwhile = f"(path.parent / {gone!r}).unlink()"
    if gone == "s.lock":  # the old socket would still answer, and busd must not replace it
        meanwhile += "; path.unlink()"
    _, second, *_, after = hand_over(path, path, meanwhile)
    assert second[2:] == ["True", "2"]
    assert after == ["False", "False", "0"]


def test_another_process_s_is_not_taken(tmp_path: Path) -> None:
    """The variable has a pid, and is only for that process."""
    path = tmp_path / "s"
    with socket.socket(socket.AF_UNIX) as strange:
        environ = {"BUSD_HANDOVER": f"1 {strange.fileno()} {strange.fileno()}"}
        done = subprocess.run(
            [sys.executable, "-c", SECOND, str(path)],
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **environ},
            check=False,
        )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "False False 0"
