"""docs/faq.md has the exact messages that Python and busd print."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from pages import ROOT, blocks

PAGE = (ROOT / "docs" / "faq.md").read_text()
SHOWN = [line for block in blocks("text", PAGE) for line in block.splitlines()]

NODE = "import bus\nbus.Node('n')\n"
CONNECT = "import bus\nbus.connect('n')\n"
SOCKET = "/run/user/1000/busd/0.sock"

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


def test_every_message_of_the_page_has_a_case() -> None:
    assert len(SHOWN) == len(CASES)
