"""`bus run turtlesim turtle_teleop_key`: steers turtle1 by the keys of a terminal.

Owns: the terminal, and the node. `bus_turtlesim.keys` defines the meaning of keys.
"""

import os
import select
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Thread
from typing import Any

import bus_ros.rclpy as rclpy
from bus.base.keys import Keys
from bus_ros.rclpy.action import ActionClient
from bus_ros.rclpy.exceptions import ParameterException
from bus_ros.rclpy.executors import ExternalShutdownException
from bus_ros.rclpy.node import Node
from bus_turtlesim.keys import ARROWS, LETTERS, QUIT, Heading, Key, Move
from bus_turtlesim.messages import RotateAbsolute, Twist

__all__ = ["TeleopTurtle", "main"]

_NAME = "teleop_turtle"
_HELP = """\
Reading from keyboard
---------------------------
Use arrow keys to move the turtle.
Use G|B|V|C|D|E|R|T keys to rotate to absolute orientations. 'F' to cancel a rotation.
'Q' to quit."""


class TeleopTurtle(Node):
    """The node."""

    def __init__(self, **options: Any) -> None:
        super().__init__(_NAME, **options)
        self._turn_scale = self.declare_parameter("scale_angular", 2.0).value
        self._forward_scale = self.declare_parameter("scale_linear", 2.0).value
        self._commands = self.create_publisher(Twist, "turtle1/cmd_vel", 1)
        self._rotations = ActionClient(self, RotateAbsolute, "turtle1/rotate_absolute")
        self._goal: Any = None

    def press(self, key: Key) -> None:
        """Do what a key means."""
        if isinstance(key, Move):
            twist = Twist()
            twist.linear.x, twist.angular.z = (
                self._forward_scale * key.forward,
                self._turn_scale * key.turn,
            )
            self._commands.publish(twist)
        elif isinstance(key, Heading):
            self._goal = self._rotations.send_goal_async(RotateAbsolute.Goal(theta=key.theta))
        elif self._goal is not None:
            self._goal.add_done_callback(_cancel)
            self._goal = None


def _cancel(sent: Any) -> None:
    if sent.exception() is None and sent.result() is not None and sent.result().accepted:
        sent.result().cancel_goal_async()


def main() -> int:
    if not sys.stdin.isatty():
        print("turtle_teleop_key reads keys from a terminal, and stdin is none", file=sys.stderr)
        return 1
    with rclpy.init(), suppress(KeyboardInterrupt, ExternalShutdownException):
        try:
            node = TeleopTurtle()
        except ParameterException as error:
            print(error, file=sys.stderr)
            return 1
        Thread(target=_spin, args=(node,), daemon=True).start()
        with _ended() as end:
            _read(node, end)
    return 0


def _spin(node: Node) -> None:
    with suppress(ExternalShutdownException):
        rclpy.spin(node)


def _read(node: TeleopTurtle, end: int) -> None:
    """Until a key or a signal ends it."""
    keys, terminal = Keys(LETTERS, ARROWS), sys.stdin.fileno()
    with _key_by_key(terminal):
        print(_HELP, flush=True)
        while True:
            ready = select.select([terminal, end], [], [])[0]
            if end in ready:
                os.read(end, 64)
                if not rclpy.ok():
                    return
            if terminal not in ready:
                continue
            data = os.read(terminal, 64)
            if not data:
                return
            for key in keys.feed(data):
                if key == QUIT:
                    return
                node.press(key)


@contextmanager
def _ended() -> Iterator[int]:
    """A descriptor that can be read from after each signal, and once rclpy has ended.

    SIGTERM does not end `select`, and a signal that comes just before `select` does not even interrupt it.
    """
    end, begin = os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK)
    before = signal.set_wakeup_fd(begin, warn_on_full_buffer=False)
    try:
        rclpy.get_default_context().on_shutdown(lambda: _notify(begin))
        yield end
    finally:
        signal.set_wakeup_fd(before)
        os.close(end)  # `begin` stays open: the callback writes to it at the very end


def _notify(pipe: int) -> None:
    with suppress(OSError):
        os.write(pipe, b"\0")


@contextmanager
def _key_by_key(terminal: int) -> Iterator[None]:
    """Each key is read at once, and not shown."""
    import termios

    before = termios.tcgetattr(terminal)
    now = termios.tcgetattr(terminal)
    now[3] &= ~(termios.ICANON | termios.ECHO)
    termios.tcsetattr(terminal, termios.TCSANOW, now)
    try:
        yield
    finally:
        termios.tcsetattr(terminal, termios.TCSANOW, before)
