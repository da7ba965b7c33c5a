"""Nodes of the facade: a native node on the engine's loop, with names, parameters and a clock as in rclpy."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from bus.errors import AccessDenied, BusError, ConfigurationError
from bus.graph import Graph
from bus.node import Node as NativeNode
from bus.parameters import file
from bus.parameters.messages import event_message
from bus.parameters.values import Change
from bus.qos import QoSProfile as NativeProfile
from bus_ros.engine import current, engine
from bus_ros.rclpy.clock import Clock, ROSClock
from bus_ros.rclpy.context import Context, get_default_context, parse_arguments
from bus_ros.rclpy.exceptions import NotInitializedException
from bus_ros.rclpy.impl.rcutils_logger import RcutilsLogger
from bus_ros.rclpy.node_entities import EntityMaker
from bus_ros.rclpy.node_graph import GraphQueries
from bus_ros.rclpy.node_parameters import ParameterMethods
from bus_ros.rclpy.parameter import Parameter, parameter_message
from bus_ros.rclpy.parameters import NodeParameters
from bus_ros.rclpy.publisher import Publisher
from bus_ros.rclpy.qos import QoSProfile, qos_profile_parameter_events
from bus_ros.rclpy.time_source import TimeSource
from bus_ros.rclpy.validate_topic_name import (
    expand_topic_name,
    validate_namespace,
    validate_node_name,
    validate_topic_name,
)

__all__ = ["Node"]

M = TypeVar("M")

CLOSE_S = 6.0
"""`destroy_node` gives what was published so long to leave the process."""


class Node(EntityMaker, GraphQueries, ParameterMethods):
    """A node named `node_name`. In the graph at once, until `destroy_node` or the end of the process; its
    publishers work without anybody spinning.

    Of `cli_args`, what stands after --ros-args is for this node, and goes before the program's own.

    Raises NotInitializedException before `rclpy.init`, InvalidNodeNameException, InvalidNamespaceException,
    RCLInvalidROSArgsError or UnknownROSArgsError for `cli_args`, and BrokerUnavailable where no busd answers
    and none could be started.
    """

    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = None,
        cli_args: Sequence[str] | None = None,
        namespace: str | None = None,
        use_global_arguments: bool = True,
        enable_rosout: bool = True,
        rosout_qos_profile: QoSProfile | int | None = None,
        start_parameter_services: bool = True,
        parameter_overrides: list[Parameter] | None = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        enable_logger_service: bool = False,
    ) -> None:
        context = context or get_default_context()
        if not context.ok():
            raise NotInitializedException("cannot create node")
        own = tuple(cli_args or ())
        _, parameters = parse_arguments(own)
        # Its ROS arguments end where they end: what follows is the program's.
        words = [*own, "--", *context.arguments] if use_global_arguments else own
        native = _make_native(node_name, namespace or "", words, context, enable_rosout)
        super().__init__(engine(), native, context, ROSClock())
        self._parameter_events: Publisher[Any] | None = None
        self._logger = RcutilsLogger(native.get_logger().name)
        self._parameters = NodeParameters(
            overrides=file.overrides(
                # Its own go before the program's.
                [*(context.parameters if use_global_arguments else ()), *parameters],
                native.full_name,
            ),
            parameter_overrides=parameter_overrides,
            allow_undeclared_parameters=allow_undeclared_parameters,
            automatically_declare_parameters_from_overrides=automatically_declare_parameters_from_overrides,
            on_change=self._tell_parameters,
        )
        self._engine.run(native.open)
        context.track_node(self)
        self._time_source = TimeSource(node=self)
        self._time_source.attach_clock(self._clock)
        if start_parameter_services:
            self._start_parameter_services()

    if not TYPE_CHECKING:  # which would take any attribute for one of a node

        def __getattr__(self, name: str) -> Any:
            hint = "" if "_parameters" in vars(self) else ": super().__init__(node_name) has not been called"
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}{hint}")

    # --- what it is

    @property
    def context(self) -> Context:
        return self._context

    @property
    def handle(self) -> "Node":
        return self

    @property
    def executor(self) -> Any:
        """Setting it takes the node away from the one that had it."""
        return self.own_executor

    @executor.setter
    def executor(self, new: Any) -> None:
        if self.own_executor is not None:
            self.own_executor.remove_node(self)
        if new is not None:
            new.add_node(self)

    def get_name(self) -> str:
        return self._native.name

    def get_namespace(self) -> str:
        return self._native.namespace

    def get_fully_qualified_name(self) -> str:
        return self._native.full_name

    def get_clock(self) -> Clock:
        """The clock that follows the parameter use_sim_time."""
        return self._clock

    def get_logger(self) -> RcutilsLogger:
        return self._logger

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """The full name; after remapping, unless it is only to be expanded."""
        validate_topic_name(topic)
        if only_expand:
            return self._expand(topic)
        return self._native.resolve_topic_name(topic)

    def resolve_service_name(self, service: str, *, only_expand: bool = False) -> str:
        """As `resolve_topic_name`."""
        validate_topic_name(service, is_service=True)
        if only_expand:
            return self._expand(service)
        return self._native.resolve_service_name(service)

    # --- waiting

    def wait_for_node(self, fully_qualified_node_name: str, timeout: float) -> bool:
        """Wait until such a node is in the graph, `timeout` seconds at most; returns whether."""
        wanted = fully_qualified_node_name
        if not wanted.startswith("/"):
            wanted = f"{self.get_namespace().rstrip('/')}/{wanted}"

        def is_there(graph: Graph) -> bool:
            return any(node.full_name == wanted for node in graph.nodes)

        try:
            self._engine.run(lambda: self._native.wait_for_graph(is_there), timeout, context=self.context)
        except TimeoutError:
            return False
        return True

    def receive_one(
        self, msg_type: type[M], topic: str, qos: NativeProfile, timeout_s: float | None
    ) -> tuple[bool, M | None]:
        """For `rclpy.wait_for_message`."""
        engine = self._engine
        subscription: Any = engine.run(lambda: self._native.create_subscription(msg_type, topic, qos))  # type: ignore[type-var]
        try:
            return True, engine.run(subscription.receive, timeout_s, context=self.context)[0]
        except TimeoutError:
            return False, None
        finally:
            engine.run(subscription.close)

    # --- ending

    def destroy_node(self) -> None:
        """Hand over what was published and leave the graph. Once more does nothing."""
        if self._is_destroyed:
            return
        self._is_destroyed = True
        if self._engine is not current():
            return  # of before a fork: it is the parent's
        if self.own_executor is not None:
            self.own_executor.remove_node(self)
        self._forget_all()
        try:
            self._engine.run(self._native.close, CLOSE_S)
        except (TimeoutError, BusError) as error:
            self._logger.warning(f"not everything could be handed over: {error or 'busd does not take it'}")

    def __enter__(self) -> "Node":
        return self

    def __exit__(self, *_: object) -> None:
        self.destroy_node()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.get_fully_qualified_name()}>"

    # --- inside

    def _expand(self, name: str) -> str:
        return expand_topic_name(name, self._native.name, self._native.namespace)

    def _graph(self) -> Graph:
        return self._engine.run(self._native.graph)

    def _start_parameter_services(self) -> None:
        from bus_ros.rclpy.parameter_service import ParameterService
        from bus_ros.rosidl import message_class

        # What the node has by itself must not keep it from its work.
        try:
            self._parameter_events = self.create_publisher(
                message_class("rcl_interfaces/msg/ParameterEvent"),
                "/parameter_events",
                qos_profile_parameter_events,
            )
        except AccessDenied as denied:
            self._logger.warning(f"changes of parameters are told to nobody: {denied}")
        try:
            ParameterService(self)
        except AccessDenied as denied:
            self._logger.warning(f"nobody else can read or set this node's parameters: {denied}")

    def _tell_parameters(self, change: Change[Parameter]) -> None:
        if self._parameter_events is not None and not self._is_destroyed:
            event = event_message(parameter_message, self.get_fully_qualified_name(), change)
            event.stamp = self._clock.now().to_msg()
            self._parameter_events.publish(event)


class _Native(NativeNode):
    """Parameters are those of the facade's node; the one beneath has none."""

    _takes_parameters = False


def _make_native(
    name: str, namespace: str, words: Sequence[str], context: Context, enable_rosout: bool
) -> NativeNode:
    validate_node_name(name)
    try:
        return _Native(
            name, namespace=namespace, arguments=words, domain=context.domain_id, rosout=enable_rosout
        )
    except ConfigurationError:
        if namespace:
            validate_namespace(namespace if namespace.startswith("/") else f"/{namespace}")
        raise
