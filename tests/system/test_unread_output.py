"""Programs whose output is a pipe without a reader end by SIGPIPE, as `PROGRAM | head -1`."""

import signal
import sys
from subprocess import PIPE, Popen

import pytest

from conftest import WAIT_S

_LOOP = "import bus\nasync def main():\n async with bus.Node('n') as node:\n  {body}\nbus.run(main())"
_PRINT = "print('line', flush=True)"
_LOG = "node.get_logger().info('line')"
PROGRAMS = {
    "a timer prints": _LOOP.format(body=f"node.create_timer(0.01, lambda: {_PRINT}); await node.spin()"),
    "a timer logs": _LOOP.format(body=f"node.create_timer(0.01, lambda: {_LOG}); await node.spin()"),
    "main prints": f"import asyncio\n{_LOOP}".format(
        body=f"\n  while True:\n   {_PRINT}\n   await asyncio.sleep(0.01)"
    ),
    "a script prints": f"import bus\nwith bus.connect('n') as node:\n while True: {_PRINT}; node.sleep(0.01)",
    "a script logs": f"import bus\nwith bus.connect('n') as node:\n while True: {_LOG}; node.sleep(0.01)",
}


def _start(program: str, *, stderr: int) -> "Popen[bytes]":
    return Popen([sys.executable, "-c", program], stdout=PIPE, stderr=stderr)


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_ends_by_sigpipe(daemon: object, name: str) -> None:
    is_log = name.endswith("logs")
    with _start(PROGRAMS[name], stderr=PIPE) as program:
        out, other = program.stdout, program.stderr
        assert out is not None and other is not None
        read, rest = (other, out) if is_log else (out, other)
        assert read.readline()
        read.close()
        assert program.wait(WAIT_S) == -signal.SIGPIPE
        assert rest.read() == b""


_OTHER_PIPE = """
import os, socket, sys
{start}
    ours, theirs = socket.socketpair()
    theirs.close()
    try:
        ours.send(b"x")
    except BrokenPipeError:
        print("caught", flush=True)
    {pause}
    print("on", flush=True)
{end}
"""
OTHER = {
    "bus.run": _OTHER_PIPE.format(
        start="import asyncio, bus\nasync def main():",
        pause="await asyncio.sleep(0.01)",
        end="bus.run(main())",
    ),
    "bus.connect": _OTHER_PIPE.format(
        start="import bus\nwith bus.connect('n') as node:", pause="node.sleep(0.01)", end=""
    ),
}


@pytest.mark.parametrize("name", OTHER)
def test_a_broken_socket_of_the_program_is_its_own_matter(daemon: object, name: str) -> None:
    with _start(OTHER[name], stderr=PIPE) as program:
        out, err = program.communicate(timeout=WAIT_S)
    assert (program.returncode, out, err) == (0, b"caught\non\n", b"")
