"""The result of a launch file; programs import it as `launch.LaunchDescription`."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from bus_launch.launch.argument import DeclareLaunchArgument
from bus_launch.launch.core import LaunchContext, LaunchDescriptionEntity
from bus_launch.launch.frontend.expose import expose_description

__all__ = ["LaunchDescription"]


class _Way(NamedTuple):
    """Through included files: arguments set by the includes (users need not give them), and the files."""

    given: frozenset[str] = frozenset()
    files: frozenset[str] = frozenset()


@expose_description
class LaunchDescription(LaunchDescriptionEntity):
    """Entities, visited one after the other."""

    def __init__(
        self,
        initial_entities: Iterable[LaunchDescriptionEntity] | None = None,
        *,
        deprecated_reason: str | None = None,
    ) -> None:
        self.__entities = list(initial_entities or ())
        self.__deprecated_reason = deprecated_reason
        for one in self.__entities:
            _check(one)

    @property
    def deprecated(self) -> bool:
        return self.__deprecated_reason is not None

    @property
    def deprecated_reason(self) -> str | None:
        return self.__deprecated_reason

    @property
    def entities(self) -> list[LaunchDescriptionEntity]:
        return self.__entities

    def add_action(self, action: LaunchDescriptionEntity) -> None:
        self.add_entity(action)

    def add_entity(self, entity: LaunchDescriptionEntity) -> None:
        _check(entity)
        if entity is self:
            raise ValueError("a launch description can't be an entity of itself")
        self.__entities.append(entity)

    def visit(self, context: LaunchContext) -> Sequence[LaunchDescriptionEntity]:
        if self.__deprecated_reason is not None:
            from bus_launch.launch import logging

            file = context.get_locals_as_dict().get("current_launch_file_path", "?")
            logging.get_logger("launch").warning(
                f"launch file [{file}] is deprecated: {self.__deprecated_reason}"
            )
        return self.__entities

    def describe_sub_entities(self) -> list[LaunchDescriptionEntity]:
        return self.__entities

    def get_launch_arguments(self, conditional_inclusion: bool = False) -> list[DeclareLaunchArgument]:
        """The arguments that are declared here and in what is included, each name once.

        Those that are declared only in some cases come last. Included files are read as far as their paths
        are known without a launch.
        """
        found: dict[str, tuple[DeclareLaunchArgument, bool]] = {}
        _collect(self.__entities, conditional_inclusion, _Way(), found)
        ordered = sorted(found.values(), key=lambda pair: pair[1])
        for argument, is_conditional in ordered:
            argument._conditionally_included = is_conditional
        return [argument for argument, _ in ordered]


def _check(entity: object) -> None:
    if not isinstance(entity, LaunchDescriptionEntity):
        raise TypeError(f"a launch description is made of actions, not of {entity!r}")


def _collect(
    entities: Iterable[LaunchDescriptionEntity],
    is_conditional: bool,
    way: _Way,
    found: dict[str, tuple[DeclareLaunchArgument, bool]],
) -> None:
    for entity in entities:
        if isinstance(entity, DeclareLaunchArgument):
            is_optional = is_conditional or entity.condition is not None
            if entity.name not in way.given and (entity.name not in found or found[entity.name][1]):
                found[entity.name] = (entity, is_optional)
            continue
        description = _included(entity, way)
        if description is not None:
            is_optional = is_conditional or getattr(entity, "condition", None) is not None
            below = _Way(
                way.given.union(getattr(entity, "given_names", ())),
                way.files.union({entity.launch_description_source.location}),  # type: ignore[attr-defined]
            )
            _collect(description.entities, is_optional, below, found)
            continue
        _collect(entity.describe_sub_entities(), is_conditional, way, found)
        for _, others in entity.describe_conditional_sub_entities():
            _collect(others, True, way, found)


def _included(entity: LaunchDescriptionEntity, way: _Way) -> LaunchDescription | None:
    """The included description, if it is known before the launch, and is not on the way here already."""
    source: Any = getattr(entity, "launch_description_source", None)
    if source is None:
        return None
    made = source.try_get_launch_description_without_context()
    if source.location in way.files:
        return None
    return made if isinstance(made, LaunchDescription) else None
