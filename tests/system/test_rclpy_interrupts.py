"""Ctrl-C at chosen instructions of the facade: it arrives once, at the next permitted place."""

import textwrap
from pathlib import Path

import pytest

from programs import on_one_loop, running

pytestmark = pytest.mark.usefixtures("daemon")

PROGRAM = """\
import rclpy, signal
from bus_ros.engine import engine
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import String

def interrupt():
    signal.raise_signal(signal.SIGINT)

rclpy.init()
node, other = rclpy.create_node('one'), rclpy.create_node('other')
try:
{what}
    print('went on')
except KeyboardInterrupt:
    print('caught')
print(engine().loop.is_interrupted)
node.destroy_node()
"""

IN_THE_EXECUTOR = """\
executor = SingleThreadedExecutor()
executor.add_node(node)
node.create_timer(1000, lambda: None)
collect = executor._collect_timers
executor._collect_timers = lambda: (collect(), interrupt())
executor.spin()
"""
TWO = """\
with engine().loop.guard:
    interrupt()
interrupt()
"""


@pytest.mark.parametrize("what", [IN_THE_EXECUTOR, TWO], ids=["in the executor", "two"])
@on_one_loop
async def test_it_comes_once(tmp_path: Path, what: str) -> None:
    """It does not end the context, and does not come again during the cleanup."""
    script = tmp_path / "program.py"
    script.write_text(PROGRAM.format(what=textwrap.indent(what, "    ")))
    async with running(tmp_path, "-m", "bus_cli", "run", script) as one:
        assert await one.end() == 0, one.lines
    assert one.lines == ["caught", "False"]


@on_one_loop
async def test_one_that_waits_at_the_end(tmp_path: Path) -> None:
    """All nodes leave the graph in order, and the engine ends."""
    script = tmp_path / "program.py"
    script.write_text(
        textwrap.dedent("""\
            import atexit
            atexit.register(lambda: print(engines.current()))  # after what rclpy has registered
            import rclpy, signal
            from bus_ros import engine as engines
            from bus_ros.engine import engine
            rclpy.init()
            nodes = [rclpy.create_node(name) for name in ('one', 'other')]
            engine().loop.guard.acquire()
            signal.raise_signal(signal.SIGINT)
            engine().loop.guard.release()
        """)
    )
    # With this variable `bus run` starts an interpreter; a fork would have imported rclpy before the program.
    async with running(tmp_path, "-m", "bus_cli", "run", script, PYTHONNODEBUGRANGES="1") as one:
        assert await one.end() == 0, one.lines
    assert one.lines == ["None"]
