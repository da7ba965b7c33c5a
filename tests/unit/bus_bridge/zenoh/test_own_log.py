"""zenoh's own log of refused connections, and all other output on stdout, which is passed on."""

import subprocess
import sys

import pytest

from rows import for_each

pytest.importorskip("zenoh")

from bus_bridge.zenoh.own_log import reason_of

BEGIN = "\x1b[2m2026-01-02T03:04:05.060051Z\x1b[0m \x1b[33m WARN\x1b[0m acc-0 ThreadId(05) \x1b[2m"
HINT = "Hint: increase the system open file limit."
PLACE = "at /root/zenoh/io/zenoh-link-commons/src/quic/unicast.rs:686"


@for_each(
    ("text", "reason"),
    [
        (f"zenoh_link_tls::unicast\x1b[0m\x1b[2m:\x1b[0m no certificates. {HINT}", "no certificates"),
        (
            "zenoh_link_commons::quic::unicast\x1b[0m\x1b[2m:\x1b[0m QUIC acceptor failed: ConnectionClosed("
            f'ConnectionClose {{ error_code: 2e, reason: b"invalid peer certificate" }}) {PLACE}. {HINT}',
            "invalid peer certificate",
        ),
        (f"zenoh_link_tcp::unicast: Too many open files {PLACE}. {HINT}", "Too many open files"),
        ("zenoh_link_tls::unicast: ", "no reason given"),
        (f"zenoh_link_tls::unicast: {'x' * 1000}", "x" * 200),
        ("zenoh::net::runtime: something else", ""),
    ],
)
def test_reasons(text: str, reason: str) -> None:
    assert reason_of((BEGIN + text).encode()) == reason


@for_each(
    "line", ["", "a line", "zenoh_link_tls::unicast: as if", "\xff\xfe", "2026Z  INFO zenoh_link_tls: up"]
)
def test_other_lines(line: str) -> None:
    assert reason_of(line.encode("latin-1")) == ""


PROGRAM = """
import asyncio, os, sys
from bus_bridge.zenoh.own_log import OwnLog

async def main():
    said = []
    log = OwnLog(said.append)
    log.open()
    line = b"2026-01-02T03:04:05Z  WARN zenoh_link_tls::unicast: no certificate\\n"
    print("one", flush=True)
    os.write(1, line[:30])
    await asyncio.sleep(0.01)
    os.write(1, line[30:] + line * 4)
    print("two")
    while log.refused < 5:
        await asyncio.sleep(0.001)
    log.close()
    print("three")
    print(said, log.reason, len(os.listdir("/dev/fd")) - before, file=sys.stderr)

before = len(os.listdir("/dev/fd"))
asyncio.run(main())
"""


def test_all_else_goes_on_to_stdout() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=60)
    assert done.stdout == "one\ntwo\nthree\n"
    said = ["a connection was refused: no certificate (zenoh does not say from where)"]
    assert done.stderr == f"{said} no certificate 3\n"


def test_without_a_stdout() -> None:
    program = (
        PROGRAM.partition("    line =")[0] + "    log.close()\n    sys.exit(log.refused)\nasyncio.run(main())"
    )
    done = subprocess.run(
        ["sh", "-c", 'exec "$0" -c "$1" >&-', sys.executable, program], timeout=60, check=False
    )
    assert done.returncode == 0
