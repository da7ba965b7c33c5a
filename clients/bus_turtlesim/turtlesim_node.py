"""`bus run turtlesim turtlesim_node`: turtles that move as they are told, and draw.

Owns: the node, its services and parameters, and the period. Browsers see the turtles on a page.
"""

import sys
from argparse import ArgumentParser
from contextlib import suppress
from typing import Any

import bus_ros.rclpy as rclpy
from bus.errors import BusError
from bus_ros.rclpy.exceptions import NameValidationException, ParameterException
from bus_ros.rclpy.executors import ExternalShutdownException
from bus_ros.rclpy.impl.rcutils_logger import RcutilsLogger
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.utilities import remove_ros_args
from bus_turtlesim.canvas import Colour
from bus_turtlesim.messages import Empty, IntegerRange, Kill, ParameterDescriptor, Spawn
from bus_turtlesim.page import NoPage, Page
from bus_turtlesim.turtle_endpoints import TurtleEndpoints
from bus_turtlesim.world import PERIOD_S, SIZE, World
from bus_web.browser import open_browser
from bus_web.place import Place, parse_place

__all__ = ["TurtleSim", "main"]

_NAME = "turtlesim"
_ANY = Place("127.0.0.1", 0)
_BACKGROUND = {"Red": 0x45, "Green": 0x56, "Blue": 0xFF}


class TurtleSim(Node):
    """The node. `page`: None if there is no page for browsers."""

    def __init__(self, page: Page | None = None, **options: Any) -> None:
        super().__init__(_NAME, **options)
        self.world = World()
        self._endpoints: dict[str, TurtleEndpoints] = {}
        self._page = page
        for colour, value in _BACKGROUND.items():
            described = ParameterDescriptor(
                description=f"{colour} channel of the background color",
                integer_range=[IntegerRange(from_value=0, to_value=255, step=1)],
            )
            self.declare_parameter(f"background_{colour[0].lower()}", value, described)
        described = ParameterDescriptor(description="If true, then turtles will be holonomic")
        self.declare_parameter("holonomic", False, described)
        self.get_logger().info(f"Starting turtlesim with node name {self.get_fully_qualified_name()}")
        self._spawn_first()
        self.create_service(Empty, "clear", self._clear)
        self.create_service(Empty, "reset", self._reset)
        self.create_service(Spawn, "spawn", self._serve_spawn)
        self.create_service(Kill, "kill", self._kill)
        self.create_timer(PERIOD_S, self._step)

    def _step(self) -> None:
        now_ns = self.get_clock().now().nanoseconds
        background = self._background()
        for endpoints in self._endpoints.values():
            endpoints.step(now_ns, background)
        if self._page is not None:
            self._page.show(self.world, background)

    def _background(self) -> Colour:
        red, green, blue = (self.get_parameter(f"background_{colour}").value for colour in "rgb")
        return red, green, blue

    def _spawn_first(self) -> None:
        self._spawn("", SIZE / 2, SIZE / 2, 0.0)

    def _spawn(self, name: str, x: float, y: float, theta: float) -> str:
        """Raises ValueError, with a text for its user."""
        name = self.world.spawn(x, y, theta, self.get_clock().now().nanoseconds, name)
        try:
            self._endpoints[name] = TurtleEndpoints(self, name, self.world.turtles[name])
        except (NameValidationException, BusError) as error:
            self.world.kill(name)
            raise ValueError(f"Can't spawn a turtle named [{name}]: {error}") from None
        self.get_logger().info(f"Spawning turtle [{name}] at x=[{x:f}], y=[{y:f}], theta=[{theta:f}]")
        return name

    def _serve_spawn(self, request: Any, response: Any) -> Any:
        try:
            response.name = self._spawn(request.name, request.x, request.y, request.theta)
        except ValueError as error:
            self.get_logger().error(str(error))
        return response

    def _kill(self, request: Any, response: Any) -> Any:
        try:
            self.world.kill(request.name)
        except ValueError as error:
            self.get_logger().error(str(error))
        else:
            self._endpoints.pop(request.name).destroy()
        return response

    def _clear(self, _: Any, response: Any) -> Any:
        self.get_logger().info("Clearing turtlesim.")
        self.world.canvas.clear()
        return response

    def _reset(self, _: Any, response: Any) -> Any:
        self.get_logger().info("Resetting turtlesim.")
        self.world.reset()
        for name in list(self._endpoints):
            self._endpoints.pop(name).destroy()
        self._spawn_first()
        return response


def main() -> int:
    options = _parser().parse_args(remove_ros_args(sys.argv)[1:])
    with rclpy.init(), suppress(KeyboardInterrupt, ExternalShutdownException):
        logger = RcutilsLogger(_NAME)
        page = _serve(options.listen)
        if options.open and page is not None:
            open_browser(page.addresses.once, logger.warning)
        try:
            node = TurtleSim(page)
        except ParameterException as error:
            logger.fatal(str(error))
            return 1
        try:
            rclpy.spin(node)
        finally:
            if page is not None:
                page.close()
    return 0


def _parser() -> ArgumentParser:
    parser = ArgumentParser(
        prog="turtlesim_node", description="Turtles that move as they are told, and draw."
    )
    parser.add_argument(
        "--listen",
        metavar="PLACE",
        type=parse_place,
        default=_ANY,
        help="where their page is: address:port or unix:PATH (default: any port of 127.0.0.1)",
    )
    parser.add_argument("--open", action="store_true", help="open the page in a browser")
    return parser


def _serve(listen: Place) -> Page | None:
    """Start the page; print its address, or the reason why there is none."""
    try:
        page = Page(listen)
    except NoPage as error:
        print(f"no page: {error}", flush=True)
        return None
    addresses = page.addresses
    if addresses.forwarding:
        print(f"first: {addresses.forwarding}")
    print(f"page: {addresses.page}", flush=True)
    return page
