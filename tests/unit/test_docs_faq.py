"""docs/faq.md has the exact messages that Python and busd print.

tests/system/test_faq.py tests its log lines.
"""

import errno
import os
import re
import subprocess
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path

import pytest

import bus
from bus.link.reach import CONNECT_S, no_answer, try_to_connect
from bus.vocabulary import DropReason
from busd.core.access import Access, AccessRule, Subject
from busd.server.listener import AlreadyRunning
from pages import ROOT, blocks
from rows import for_each

PAGE = (ROOT / "docs" / "faq.md").read_text()
SHOWN = [line for block in blocks("text", PAGE) for line in block.splitlines()]

NODE = "import bus\nbus.Node('n')\n"
CONNECT = "import bus\nbus.connect('n')\n"
SOCKET = "/run/user/1000/busd/0.sock"
SYSTEM_SOCKET = "/run/busd/0.sock"

CASES = {
    "a message": ("x.py", "from bus.msg.std_msgs import String\n", {"bus.py": ""}, {}),
    "a name": ("x.py", NODE, {"bus.py": ""}, {}),
    "itself": ("bus.py", NODE, {}, {}),
    "rclpy": ("x.py", "import rclpy\n", {}, {}),
    "std_msgs": ("x.py", "from std_msgs.msg import String\n", {}, {}),
    "no busd": ("x.py", CONNECT, {}, {"BUSD_SOCKET": SOCKET, "BUSD_AUTOSTART": "0"}),
    "no domain": ("x.py", CONNECT, {}, {"BUSD_DOMAIN": "abc"}),
    "few files": (
        "x.py",
        "import resource\nresource.setrlimit(resource.RLIMIT_NOFILE, (12, 12))\n" + CONNECT,
        {},
        {},
    ),
}


def _last_line(folder: Path, program: str, environ: dict[str, str]) -> str:
    ended = subprocess.run(
        [sys.executable, program],
        cwd=folder,
        env={name: value for name, value in os.environ.items() if "BUSD" not in name} | environ,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert ended.returncode == 1
    return ended.stderr.splitlines()[-1]


@pytest.mark.parametrize("case", CASES)
def test_the_page_has_the_message(case: str, tmp_path: Path) -> None:
    name, program, others, environ = CASES[case]
    for other, text in {name: program, **others}.items():
        (tmp_path / other).write_text(text)
    if environ.get("BUSD_SOCKET") == SOCKET and Path(SOCKET).exists():
        pytest.skip(f"a busd listens on {SOCKET}")
    line = _last_line(tmp_path, name, environ)
    assert re.sub(r" \(consider renaming .*", "", line) in SHOWN  # Python 3.13 adds this text


def _refusals() -> Iterator[str]:
    """Texts for a user without any rule, and for one with a rule for another topic."""
    alice = Subject(1001, frozenset({1001}))
    why = Access(1000).why_turned_away(alice)
    yield f"BrokerUnavailable: busd at {SYSTEM_SOCKET} refused this process: {why}"
    rule = AccessRule(
        topics=("/odom",), actions=frozenset({"publish"}), uids=frozenset({1001}), names={1001: "alice"}
    )
    yield _as_in_a_traceback(bus.AccessDenied(Access(1000, (rule,)).why_not(alice, "publish", "/cmd_vel")))


def _as_in_a_traceback(error: bus.BusError) -> str:
    return traceback.format_exception_only(error)[-1].rstrip("\n")


TEXTS = [
    *_refusals(),
    _as_in_a_traceback(bus.QuotaExceeded("endpoints of a process", used=4096, limit=4096)),
    _as_in_a_traceback(bus.PayloadTooLarge("/map", size_bytes=73400328, limit_bytes=67108864)),
    f"BrokerUnavailable: {no_answer(SOCKET, CONNECT_S)}",
    f"busd: {AlreadyRunning(Path(SOCKET), 4711)}",
]
"""Made as the library and busd make them."""


@for_each("text", TEXTS)
def test_the_page_has_the_text(text: str) -> None:
    assert text in SHOWN


class Forbidden:
    """A socket of another user."""

    def __init__(self, *arguments: int) -> None:
        pass

    def setblocking(self, flag: bool) -> None:
        pass

    def connect(self, path: str) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    def close(self) -> None:
        pass


def test_the_page_has_the_error_of_a_socket_of_another_user(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bus.link.reach._Socket", Forbidden)
    with pytest.raises(bus.BrokerUnavailable) as caught:
        try_to_connect(SYSTEM_SOCKET)
    assert f"BrokerUnavailable: {caught.value}" in SHOWN


def test_every_message_of_the_page_has_a_case() -> None:
    assert len(SHOWN) == len(CASES) + len(TEXTS) + 1


def test_every_reason_for_a_loss_has_a_remedy() -> None:
    table = PAGE.partition("## Messages are lost")[2].partition("\n## ")[0]
    assert {*re.findall(r"`([a-z_]+)`", "".join(re.findall(r"^\| (`.*?) \|", table, re.MULTILINE)))} == {
        *DropReason
    }
