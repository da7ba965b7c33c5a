"""Actions for programs of the bus: goals that take their time, feedback on the way, and a result at the end.

    import bus
    from bus_actions import ActionClient, ActionServer, find_action

    Fibonacci = find_action("example_interfaces/action/Fibonacci")

    async def execute(goal):
        sequence = [0, 1]
        for _ in range(goal.request.order - 1):
            sequence.append(sequence[-1] + sequence[-2])
            yield Fibonacci.Feedback(sequence=sequence)
            await asyncio.sleep(1)
        yield Fibonacci.Result(sequence=sequence)

    async with bus.Node("server") as node, ActionServer(node, Fibonacci, "fibonacci", execute):
        await node.spin()

Names are imported when they are first used.

Invariants:

- A goal changes its state only by the table in `goal_state.py`; names and numbers are ROS 2's.
- `goal_state.py`, `goal_table.py` and `graph.py` are pure. rclpy's actions (`bus_ros`) use them, too.
- The number of active goals and the time for which results stay are bounded.
- The endpoints of one end appear in a fixed order: a program that sees the last one finds all of them.

Read first: `goal_state.py`, then `server.py`.

Tests: `tests/unit/bus_actions/`, on `tests/world/action_world.py`; `tests/system/test_actions.py`.
"""

from typing import TYPE_CHECKING, Any

from bus import _import

if TYPE_CHECKING:
    from bus_actions.action_type import Action, find_action
    from bus_actions.client import ActionClient, ActionClientStatistics, ClientGoal
    from bus_actions.endpoints import ActionQoS
    from bus_actions.errors import ActionUnavailable, GoalAborted, GoalCanceled, GoalRejected
    from bus_actions.goal_state import GoalStatus, InvalidTransition
    from bus_actions.server import ActionServer, ActionServerStatistics, ServerGoal

_HOMES = {
    "bus_actions.action_type": ("Action", "find_action"),
    "bus_actions.client": ("ActionClient", "ActionClientStatistics", "ClientGoal"),
    "bus_actions.endpoints": ("ActionQoS",),
    "bus_actions.errors": ("ActionUnavailable", "GoalAborted", "GoalCanceled", "GoalRejected"),
    "bus_actions.goal_state": ("GoalStatus", "InvalidTransition"),
    "bus_actions.server": ("ActionServer", "ActionServerStatistics", "ServerGoal"),
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "Action",
    "ActionClient",
    "ActionClientStatistics",
    "ActionQoS",
    "ActionServer",
    "ActionServerStatistics",
    "ActionUnavailable",
    "ClientGoal",
    "GoalAborted",
    "GoalCanceled",
    "GoalRejected",
    "GoalStatus",
    "InvalidTransition",
    "ServerGoal",
    "find_action",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(_import(_HOME_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
