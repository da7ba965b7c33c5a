"""The common part of both kinds of nodes: name, place in the graph, parameters, clock, logger."""

from collections.abc import Callable, Sequence
from typing import Any

from bus.graph import Graph
from bus.node import Node as NativeNode
from bus.parameters import file
from bus.parameters.store import Change
from bus_ros.rclpy.clock import BaseClock
from bus_ros.rclpy.context import Context, get_default_context, parse_arguments
from bus_ros.rclpy.destroyable import Handle
from bus_ros.rclpy.exceptions import NotInitializedException
from bus_ros.rclpy.impl.native_node import make_native
from bus_ros.rclpy.impl.node_graph import NodeGraph
from bus_ros.rclpy.impl.node_parameters import NodeParameters
from bus_ros.rclpy.impl.rcutils_logger import RcutilsLogger
from bus_ros.rclpy.parameter import Parameter

__all__ = ["BaseNode", "NativeParts", "base_of"]


class NativeParts:
    """The native node of a node of rclpy, and its arguments; not yet connected.

    Raises as `rclpy.node.Node`.
    """

    def __init__(
        self,
        node_name: str,
        namespace: str | None,
        context: Context | None,
        cli_args: Sequence[str] | None,
        *,
        use_global_arguments: bool,
        enable_rosout: bool,
        on_error: Callable[[BaseException], None] | None = None,
    ) -> None:
        self.context = context = context or get_default_context()
        if not context.ok():
            raise NotInitializedException("cannot create node")
        own = tuple(cli_args or ())
        _, parameters = parse_arguments(own)
        # `--` ends its ROS arguments: the program's follow.
        words = [*own, "--", *context.arguments] if use_global_arguments else own
        self.node: NativeNode = make_native(
            node_name, namespace or "", words, context, enable_rosout, on_error=on_error
        )
        self.overrides = file.overrides(
            # Its own parameters override the program's.
            [*(context.parameters if use_global_arguments else ()), *parameters],
            self.node.full_name,
        )


class BaseNode(NodeGraph, NodeParameters):
    """Base of `Node` and of `rclpy.experimental.AsyncNode`."""

    def __init__(
        self,
        parts: NativeParts,
        handle: Handle,
        read_graph: Callable[[], Graph],
        on_parameters: Callable[[Change[Parameter]], object],
        *,
        parameter_overrides: list[Parameter] | None,
        allow_undeclared_parameters: bool,
        automatically_declare_parameters_from_overrides: bool,
    ) -> None:
        NodeGraph.__init__(self, parts.node, handle, read_graph)
        self.__native = parts.node
        self._context = parts.context
        self._logger = RcutilsLogger(parts.node.get_logger().name)
        NodeParameters.__init__(
            self,
            overrides=parts.overrides,
            parameter_overrides=parameter_overrides,
            allow_undeclared_parameters=allow_undeclared_parameters,
            automatically_declare_parameters_from_overrides=automatically_declare_parameters_from_overrides,
            on_change=on_parameters,
        )

    @property
    def context(self) -> Context:
        return self._context

    @property
    def native(self) -> NativeNode:
        """The native node below."""
        return self.__native

    def get_clock(self) -> BaseClock:
        """The clock that follows the parameter use_sim_time."""
        raise NotImplementedError

    def get_logger(self) -> RcutilsLogger:
        return self._logger

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.get_fully_qualified_name()}>"


def base_of(node: BaseNode) -> Any:
    """The class of rclpy among the bases of a node: a program's own class may override its methods."""
    return next(cls for cls in type(node).__mro__ if BaseNode in cls.__bases__)
