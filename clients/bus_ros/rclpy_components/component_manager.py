"""The node of a container: loads, unloads and lists components."""

import inspect
from typing import Any, Final

from bus_ros.rclpy.executors import Executor
from bus_ros.rclpy.logging import LoggingSeverity
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.parameter import Parameter
from bus_ros.rclpy_components.registry import ComponentError, find_class
from bus_ros.rosidl import service_class

__all__ = ["ComponentManager"]

_NAME: Final = "ComponentManager"
_OF_CONTEXT: Final = "use_global_arguments"


class ComponentManager(Node):
    """Has the services of ROS 2's container, in composition_interfaces. Components spin in `executor`."""

    def __init__(self, executor: Executor, name: str = _NAME, **options: Any) -> None:
        super().__init__(name, **options)
        self._executor_of_components = executor
        self._components: dict[int, Node] = {}
        self._last_id = 0
        for kind, service, callback in (
            ("LoadNode", "load_node", self._load),
            ("UnloadNode", "unload_node", self._unload),
            ("ListNodes", "list_nodes", self._list),
        ):
            self.create_service(
                service_class(f"composition_interfaces/srv/{kind}"), f"~/_container/{service}", callback
            )

    def destroy_node(self) -> None:
        """Destroy the components, then this node."""
        for unique_id in list(self._components):
            self._end(unique_id)
        super().destroy_node()

    def _load(self, request: Any, response: Any) -> Any:
        self.get_logger().info(f"Load component: {request.plugin_name} of package {request.package_name}")
        before = self.context.nodes_of_this_thread()
        try:
            component = _make(request)
        except (Exception, SystemExit) as error:  # of the component's module or constructor
            for node in self.context.nodes_of_this_thread() - before:
                if isinstance(node, Node):
                    # Not its class's own: that may need what the constructor did not make.
                    Node.destroy_node(node)
            text = str(error) if isinstance(error, ComponentError) else f"{type(error).__name__}: {error}"
            self.get_logger().error(f"Failed to load component: {text}")
            response.error_message = text
            return response
        self._executor_of_components.add_node(component)
        self._last_id += 1
        self._components[self._last_id] = component
        response.success = True
        response.unique_id = self._last_id
        response.full_node_name = component.get_fully_qualified_name()
        return response

    def _unload(self, request: Any, response: Any) -> Any:
        if request.unique_id not in self._components:
            response.error_message = f"No node found with unique_id: {request.unique_id}"
            self.get_logger().warning(response.error_message)
            return response
        self._end(request.unique_id)
        response.success = True
        return response

    def _list(self, request: Any, response: Any) -> Any:
        response.unique_ids = list(self._components)
        response.full_node_names = [one.get_fully_qualified_name() for one in self._components.values()]
        return response

    def _end(self, unique_id: int) -> None:
        component = self._components.pop(unique_id)
        self._executor_of_components.remove_node(component)
        component.destroy_node()


def _make(request: Any) -> Node:
    """Make the component of a LoadNode request. Raises ComponentError, or any error of its constructor."""
    if request.log_level not in set(LoggingSeverity):
        allowed = ", ".join(f"{one.name} {one.value}" for one in LoggingSeverity)
        raise ComponentError(f"{request.log_level} is no severity ({allowed})")
    component_class = find_class(request.package_name, request.plugin_name)
    component = component_class(**_options_for(component_class, _options(request)))
    if request.log_level:
        component.get_logger().set_level(request.log_level)
    return component


def _options(request: Any) -> dict[str, Any]:
    """The arguments of the class, as far as the request needs them.

    Extra arguments of ROS 2's container (`use_intra_process_comms`, `forward_global_arguments`) have no
    effect: the route of messages does not depend on them, and the container's arguments are its own.
    """
    names = [f"__node:={request.node_name}"] if request.node_name else []
    names += [f"__ns:={request.node_namespace}"] if request.node_namespace else []
    options: dict[str, Any] = {_OF_CONTEXT: False}
    if rules := [*names, *request.remap_rules]:
        options["cli_args"] = ["--ros-args", *(word for rule in rules for word in ("-r", rule))]
    if request.parameters:
        options["parameter_overrides"] = [Parameter.from_parameter_msg(one) for one in request.parameters]
    return options


def _options_for(component_class: type[Node], options: dict[str, Any]) -> dict[str, Any]:
    """The options that the class accepts. Raises ComponentError if it does not accept a needed one."""
    try:
        parameters = inspect.signature(component_class).parameters
    except ValueError:
        return options
    if any(one.kind is inspect.Parameter.VAR_KEYWORD for one in parameters.values()):
        return options
    missing = [name for name in options if name not in parameters and name != _OF_CONTEXT]
    if missing:
        raise ComponentError(
            f"{component_class.__name__} can't get a name, rules or parameters: its __init__ has no "
            f"{' and no '.join(missing)}; write __init__(self, **kwargs) and pass them to Node.__init__"
        )
    return {name: value for name, value in options.items() if name in parameters}
