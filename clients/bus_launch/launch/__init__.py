"""Launch files and their engine; programs import it as `launch`."""

from bus_launch.launch import (
    actions,
    conditions,
    descriptions,
    event_handlers,
    events,
    frontend,
    launch_description_sources,
    logging,
    substitutions,
    utilities,
)
from bus_launch.launch.action import Action
from bus_launch.launch.core import (
    BaseEventHandler,
    Condition,
    Event,
    EventHandler,
    LaunchContext,
    LaunchDescriptionEntity,
    SomeActionsType,
    SomeEntitiesType,
    SomeSubstitutionsType,
    SomeSubstitutionsType_types_tuple,
    Substitution,
)
from bus_launch.launch.errors import InvalidLaunchFileError
from bus_launch.launch.launch_description import LaunchDescription
from bus_launch.launch.launch_description_sources import LaunchDescriptionSource
from bus_launch.launch.launch_introspector import LaunchIntrospector
from bus_launch.launch.launch_service import LaunchService

__all__ = [
    "Action",
    "BaseEventHandler",
    "Condition",
    "Event",
    "EventHandler",
    "InvalidLaunchFileError",
    "LaunchContext",
    "LaunchDescription",
    "LaunchDescriptionEntity",
    "LaunchDescriptionSource",
    "LaunchIntrospector",
    "LaunchService",
    "SomeActionsType",
    "SomeEntitiesType",
    "SomeSubstitutionsType",
    "SomeSubstitutionsType_types_tuple",
    "Substitution",
    "actions",
    "conditions",
    "descriptions",
    "event_handlers",
    "events",
    "frontend",
    "launch_description_sources",
    "logging",
    "substitutions",
    "utilities",
]
