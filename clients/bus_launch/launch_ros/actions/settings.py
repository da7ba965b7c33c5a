"""Actions that set something for all nodes after them, until the end of their group."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from bus.names import validate_namespace
from bus_launch.launch import logging
from bus_launch.launch.action import Action
from bus_launch.launch.actions import TimerAction
from bus_launch.launch.core import (
    LaunchContext,
    LaunchDescriptionEntity,
    SomeSubstitutionsType,
    Substitution,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.frontend import Entity, Parser, expose_action
from bus_launch.launch_ros.descriptions import Parameter, ParameterFile
from bus_launch.launch_ros.namespaces import make_namespace_absolute, prefix_namespace
from bus_launch.launch_ros.parameter_values import normalized

__all__ = [
    "PushROSNamespace",
    "PushRosNamespace",
    "ROSTimer",
    "RosTimer",
    "SetParameter",
    "SetParametersFromFile",
    "SetROSLogDir",
    "SetRemap",
    "SetUseSimTime",
]

_Parsed = tuple[type[Action], dict[str, Any]]


@expose_action("push-ros-namespace")
@expose_action("push_ros_namespace")
class PushRosNamespace(Action):
    """Nodes are in this namespace, inside of those pushed before."""

    def __init__(self, namespace: SomeSubstitutionsType, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__namespace = normalize_to_list_of_substitutions(namespace)

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        _, kwargs = super().parse(entity, parser)
        kwargs["namespace"] = parser.parse_substitution(entity.get_attr("namespace"))
        return cls, kwargs

    @property
    def namespace(self) -> list[Substitution]:
        return self.__namespace

    def execute(self, context: LaunchContext) -> None:
        base = context.launch_configurations.get("ros_namespace")
        namespace = make_namespace_absolute(
            prefix_namespace(base, perform_substitutions(context, self.__namespace))
        )
        validate_namespace(namespace)
        context.launch_configurations["ros_namespace"] = namespace


PushROSNamespace = PushRosNamespace


def _add_shared(context: LaunchContext, one: Any) -> None:
    """A new list: the list of the outer group is not changed."""
    configurations = context.launch_configurations
    configurations["global_params"] = [*configurations.get("global_params", []), one]


@expose_action("set_parameter")
class SetParameter(Action):
    """Nodes have this parameter; their own values come later, and take precedence."""

    def __init__(self, name: SomeSubstitutionsType, value: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__parameter = Parameter(name, value)

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        _, kwargs = super().parse(entity, parser)
        kwargs["name"] = parser.parse_substitution(entity.get_attr("name"))
        kwargs["value"] = parser.parse_if_substitutions(entity.get_attr("value", data_type=None))
        return cls, kwargs

    @property
    def name(self) -> list[Substitution]:
        return self.__parameter.name

    @property
    def value(self) -> Any:
        return self.__parameter.value

    def execute(self, context: LaunchContext) -> None:
        name, value = self.__parameter.evaluate(context)
        _add_shared(context, normalized({name: value}))


@expose_action("set_use_sim_time")
class SetUseSimTime(SetParameter):
    """Nodes have the parameter use_sim_time."""

    def __init__(self, value: Any, **kwargs: Any) -> None:
        super().__init__("use_sim_time", value, **kwargs)

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        _, kwargs = super(SetParameter, cls).parse(entity, parser)
        kwargs["value"] = parser.parse_if_substitutions(entity.get_attr("value", data_type=None))
        return cls, kwargs


@expose_action("set_parameters_from_file")
class SetParametersFromFile(Action):
    """Nodes read this parameter file, before their own."""

    def __init__(self, filename: SomeSubstitutionsType, node_name: Any = None, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__file = ParameterFile(filename)

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        _, kwargs = super().parse(entity, parser)
        kwargs["filename"] = parser.parse_substitution(entity.get_attr("filename"))
        return cls, kwargs

    def execute(self, context: LaunchContext) -> None:
        _add_shared(context, ParameterFile(str(self.__file.evaluate(context))))


@expose_action("set_remap")
class SetRemap(Action):
    """Nodes have this remapping, before their own."""

    def __init__(self, src: SomeSubstitutionsType, dst: SomeSubstitutionsType, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__src = normalize_to_list_of_substitutions(src)
        self.__dst = normalize_to_list_of_substitutions(dst)

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        _, kwargs = super().parse(entity, parser)
        kwargs["src"] = parser.parse_substitution(entity.get_attr("from"))
        kwargs["dst"] = parser.parse_substitution(entity.get_attr("to"))
        return cls, kwargs

    @property
    def src(self) -> list[Substitution]:
        return self.__src

    @property
    def dst(self) -> list[Substitution]:
        return self.__dst

    def execute(self, context: LaunchContext) -> None:
        pair = tuple(
            normalize_to_list_of_substitutions(perform_substitutions(context, one))
            for one in (self.__src, self.__dst)
        )
        configurations = context.launch_configurations
        configurations["ros_remaps"] = [*configurations.get("ros_remaps", []), pair]


@expose_action("set_ros_log_dir")
class SetROSLogDir(Action):
    """The folder of log files from now on; a relative path is in the present one."""

    def __init__(self, new_log_dir: SomeSubstitutionsType, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__folder = normalize_to_list_of_substitutions(new_log_dir)

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        _, kwargs = super().parse(entity, parser)
        kwargs["new_log_dir"] = parser.parse_substitution(entity.get_attr("new_log_dir"))
        return cls, kwargs

    @property
    def log_dir(self) -> list[Substitution]:
        return self.__folder

    def execute(self, context: LaunchContext) -> None:
        present = context.environment.get("ROS_LOG_DIR") or logging.launch_config.log_dir
        folder = os.path.join(present, perform_substitutions(context, self.__folder))  # noqa: PTH118
        Path(folder).mkdir(parents=True, exist_ok=True)
        context.environment["ROS_LOG_DIR"] = folder
        logging.launch_config.log_dir = folder


@expose_action("ros_timer")
class RosTimer(TimerAction):
    """Visits actions after a period of the machine's time; simulated time is not looked at."""

    def __init__(
        self,
        *,
        period: float | SomeSubstitutionsType,
        actions: Iterable[LaunchDescriptionEntity],
        **kwargs: Any,
    ) -> None:
        super().__init__(period=period, actions=actions, **kwargs)


ROSTimer = RosTimer
