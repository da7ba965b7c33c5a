"""Launch files and their engine; programs import it as `launch`.

    description -> `launch_service.py` -> event -> handlers (`event_handlers.py`) -> actions -> more events
                        |                                                               |
                   `core.py` (LaunchContext: the state of a launch)   `child.py` (a process) <- `actions/`

`launch_description_sources.py` reads files, `frontend/` markup languages, `substitutions/` are texts known
later, `guard.py` is a separate program that ends the processes of a dead launch.

Invariants:

- Events are handled one after the other, in order, on one event loop. Other threads use `emit_event`.
- `core.py` knows no actions and no processes; `child.py` knows no events.
- Each process leads its own process group; signals go to the group.
- Classes of users derive from those here, so their methods and arguments are ROS 2's.

Read first: `core.py`, then `launch_service.py`. Tests: `tests/unit/bus_launch/launch/`,
`tests/system/test_launch.py`, `tests/system/test_launch_processes.py`.
"""

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
    SomeActionsType_types_tuple,
    SomeEntitiesType,
    SomeEntitiesType_types_tuple,
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
    "SomeActionsType_types_tuple",
    "SomeEntitiesType",
    "SomeEntitiesType_types_tuple",
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
