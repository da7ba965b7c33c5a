"""Descriptions that actions take; programs import it as `launch_ros.descriptions`."""

from collections.abc import Iterable
from typing import Any

from bus_launch.launch.core import (
    Condition,
    SomeSubstitutionsType,
    Substitution,
    normalize_to_list_of_substitutions,
)
from bus_launch.launch.frontend import Entity, Parser
from bus_launch.launch_ros.parameter_descriptions import Parameter, ParameterFile
from bus_launch.launch_ros.parameter_values import ParameterValue
from bus_launch.launch_ros.remap_rules import normalize_remap_rules
from bus_launch.launch_ros.tags import parse_condition, parse_extra_arguments, parse_parameters, parse_remaps
from bus_launch.launch_ros.utilities import normalize_parameters

__all__ = ["ComposableNode", "Parameter", "ParameterFile", "ParameterValue"]

__path__: list[str] = []  # there may be modules in it: a file for each class, as in ROS 2


class ComposableNode:
    """A component for a container: the class to load, and the name and settings of its node."""

    def __init__(
        self,
        *,
        package: SomeSubstitutionsType,
        plugin: SomeSubstitutionsType,
        name: SomeSubstitutionsType | None = None,
        namespace: SomeSubstitutionsType | None = None,
        parameters: Iterable[Any] | None = None,
        remappings: Iterable[tuple[SomeSubstitutionsType, SomeSubstitutionsType]] | None = None,
        extra_arguments: Iterable[Any] | None = None,
        condition: Condition | None = None,
    ) -> None:
        """`plugin`: the registered type, or `module:Class` of a node in Python. `parameters`: paths of files,
        and dicts. `extra_arguments`: for the container. It is loaded only if `condition` is true.
        """
        self.__package = normalize_to_list_of_substitutions(package)
        self.__plugin = normalize_to_list_of_substitutions(plugin)
        self.__name = None if name is None else normalize_to_list_of_substitutions(name)
        self.__namespace = None if namespace is None else normalize_to_list_of_substitutions(namespace)
        self.__parameters = None if parameters is None else normalize_parameters(parameters)
        self.__remappings = list(normalize_remap_rules(remappings)) if remappings else None
        self.__extra = normalize_parameters(extra_arguments) if extra_arguments else None
        self.__condition = condition

    @classmethod
    def parse(cls, parser: Parser, entity: Entity) -> tuple[type["ComposableNode"], dict[str, Any]]:
        """The class, and the keyword arguments that a tag `<composable_node>` stands for."""
        kwargs: dict[str, Any] = {}
        for attribute, argument in (("pkg", "package"), ("plugin", "plugin"), ("name", "name")):
            kwargs[argument] = parser.parse_substitution(entity.get_attr(attribute))
        namespace = entity.get_attr("namespace", optional=True)
        if namespace is not None:
            kwargs["namespace"] = parser.parse_substitution(namespace)
        found = {
            "condition": parse_condition(entity, parser),
            "parameters": parse_parameters(entity, parser),
            "remappings": parse_remaps(entity, parser),
            "extra_arguments": parse_extra_arguments(entity, parser),
        }
        entity.assert_entity_completely_parsed()
        return cls, kwargs | {name: value for name, value in found.items() if value is not None}

    @property
    def package(self) -> list[Substitution]:
        return self.__package

    @property
    def node_plugin(self) -> list[Substitution]:
        return self.__plugin

    @property
    def node_name(self) -> list[Substitution] | None:
        return self.__name

    @property
    def node_namespace(self) -> list[Substitution] | None:
        return self.__namespace

    @property
    def parameters(self) -> list[Any] | None:
        """As `launch_ros.utilities.normalize_parameters` returns them."""
        return self.__parameters

    @property
    def remappings(self) -> list[tuple[list[Substitution], list[Substitution]]] | None:
        return self.__remappings

    @property
    def extra_arguments(self) -> list[Any] | None:
        return self.__extra

    def condition(self) -> Condition | None:
        return self.__condition
