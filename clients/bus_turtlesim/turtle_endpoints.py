"""The endpoints of a turtle on the bus: its topics, services and action.

Owns: the goal that the turtle follows, and how goals end. How it moves is `bus_turtlesim.world`'s.
"""

from struct import Struct
from typing import Any

from bus_ros.rclpy.action import ActionServer, CancelResponse, GoalResponse
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.task import Future
from bus_turtlesim.canvas import Colour, Pen
from bus_turtlesim.messages import (
    Color,
    Pose,
    RotateAbsolute,
    SetPen,
    TeleportAbsolute,
    TeleportRelative,
    Twist,
)
from bus_turtlesim.world import Turtle, are_finite

__all__ = ["DEPTH", "TurtleEndpoints"]

DEPTH = 7
_FIVE = Struct("5f")


class TurtleEndpoints:
    """The endpoints of one turtle, on its node; `destroy` takes them away."""

    def __init__(self, node: Node, name: str, turtle: Turtle) -> None:
        self.turtle = turtle
        self._node, self._name = node, name
        self._goal: Any = None
        self._result: Future[Any] = Future()
        self._destroyers: list[Any] = []
        try:
            self._commands = node.create_subscription(Twist, f"{name}/cmd_vel", self._obey, DEPTH)
            self._destroyers.append(lambda: node.destroy_subscription(self._commands))
            self._poses = self._publisher(Pose, "pose")
            self._colours = self._publisher(Color, "color_sensor")
            self._service(SetPen, "set_pen", self._set_pen)
            self._service(TeleportRelative, "teleport_relative", self._jump)
            self._service(TeleportAbsolute, "teleport_absolute", self._teleport)
            self._server = ActionServer(
                node,
                RotateAbsolute,
                f"{name}/rotate_absolute",
                lambda _: None,  # `_accept` has each goal executed in its own way
                goal_callback=self._judge,
                handle_accepted_callback=self._accept,
                cancel_callback=lambda _: CancelResponse.ACCEPT,
            )
            self._destroyers.append(self._server.destroy)
        except BaseException:
            self.destroy()
            raise

    def destroy(self) -> None:
        """Leave the graph; a goal that runs is aborted."""
        self._end("abort")
        for destroy in reversed(self._destroyers):
            destroy()

    def step(self, now_ns: int, background: Colour) -> None:
        """Move, and publish the pose of the turtle."""
        turtle, logger = self.turtle, self._node.get_logger()
        if self._goal is not None and self._goal.is_cancel_requested:
            logger.info("Rotation goal canceled")
            turtle.halt()
            self._end("canceled")
        wall, rotation = turtle.step(now_ns)
        if rotation is not None and self._goal is not None:
            self._goal.publish_feedback(RotateAbsolute.Feedback(remaining=_single(rotation.remaining)))
            if rotation.is_done:
                logger.info("Rotation goal completed successfully")
                self._end("succeed")
        if wall is not None:
            logger.warning(f"Oh no! I hit the wall! (Clamping from [x={wall[0]:f}, y={wall[1]:f}])")
        state = _singles(turtle.x, turtle.y, turtle.theta, turtle.speed, turtle.velocity[2])
        x, y, theta, linear, angular = state
        self._poses.publish(Pose(x=x, y=y, theta=theta, linear_velocity=linear, angular_velocity=angular))
        red, green, blue = turtle.colour() or background
        self._colours.publish(Color(r=red, g=green, b=blue))

    def _publisher(self, kind: Any, topic: str) -> Any:
        made = self._node.create_publisher(kind, f"{self._name}/{topic}", DEPTH)
        self._destroyers.append(lambda: self._node.destroy_publisher(made))
        return made

    def _service(self, kind: Any, name: str, callback: Any) -> None:
        made = self._node.create_service(kind, f"{self._name}/{name}", callback)
        self._destroyers.append(lambda: self._node.destroy_service(made))

    def _obey(self, twist: Any) -> None:
        forward, left, turn = twist.linear.x, twist.linear.y, twist.angular.z
        if not are_finite(forward, left, turn):
            self._refuse("velocity", f"[x={forward}, y={left}, turn={turn}]")
            return
        if not self._node.get_parameter("holonomic").value:
            left = 0.0
        self.turtle.command(forward, left, turn, self._node.get_clock().now().nanoseconds)
        if self._goal is not None:
            self._node.get_logger().warning("Velocity command received during rotation goal. Aborting goal")
            self._end("abort")

    def _set_pen(self, request: Any, response: Any) -> Any:
        if request.off:
            self.turtle.pen = self.turtle.pen._replace(is_on=False)
        else:
            self.turtle.pen = Pen((request.r, request.g, request.b), request.width or 1)
        return response

    def _jump(self, request: Any, response: Any) -> Any:
        if are_finite(request.linear, request.angular):
            self.turtle.jump(request.linear, request.angular)
        else:
            self._refuse("way", f"[linear={request.linear}, angular={request.angular}]")
        return response

    def _teleport(self, request: Any, response: Any) -> Any:
        if are_finite(request.x, request.y, request.theta):
            self.turtle.teleport(request.x, request.y, request.theta)
        else:
            self._refuse("place", f"[x={request.x}, y={request.y}, theta={request.theta}]")
        return response

    def _judge(self, goal: Any) -> GoalResponse:
        if are_finite(goal.theta):
            return GoalResponse.ACCEPT
        self._refuse("heading", f"[theta={goal.theta}]")
        return GoalResponse.REJECT

    def _refuse(self, what: str, value: str) -> None:
        self._node.get_logger().error(f"Ignored a {what} for [{self._name}] that is not finite: {value}")

    def _accept(self, goal: Any) -> None:
        if self._goal is not None:
            self._node.get_logger().warning(
                "Rotation goal received before a previous goal finished. Aborting previous goal"
            )
            self._end("abort")
        self._goal, self._result = goal, Future()
        self.turtle.rotate(goal.request.theta)
        result = self._result

        async def ended(_: Any) -> Any:
            return await result

        goal.execute(ended)

    def _end(self, how: str) -> None:
        """`succeed`, `abort` or `canceled`; without effect if no goal runs."""
        if self._goal is not None:
            getattr(self._goal, how)()
            self._result.set_result(RotateAbsolute.Result(delta=_single(self.turtle.delta)))
            self._goal = None


def _single(number: float) -> float:
    return _singles(number, 0.0, 0.0, 0.0, 0.0)[0]


def _singles(*numbers: float) -> tuple[float, ...]:
    """Rounded to the 32 bits that ROS 2 sends, for it shows them so."""
    return _FIVE.unpack(_FIVE.pack(*numbers))
