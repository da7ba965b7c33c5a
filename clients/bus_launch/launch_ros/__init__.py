"""Launch files that start nodes; programs import it as `launch_ros`."""

from bus_launch.launch_ros import (
    actions,
    descriptions,
    event_handlers,
    events,
    substitutions,
    utilities,
)

__all__ = ["actions", "descriptions", "event_handlers", "events", "substitutions", "utilities"]
