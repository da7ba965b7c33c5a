"""bus_launch.launch_ros.event_handlers: the transitions and lifecycle nodes that they handle."""

from types import SimpleNamespace
from typing import Any

import pytest

from bus_launch.launch.core import LaunchContext
from bus_launch.launch_ros.event_handlers import OnStateTransition
from bus_launch.launch_ros.events.lifecycle import StateTransition

FIRST: Any = object()
SECOND: Any = object()


class Transition(StateTransition):
    """A transition with given texts."""

    def __init__(self, action: Any, transition: str, start: str, goal: str) -> None:
        self._texts = SimpleNamespace(
            action=action, transition=transition, start_state=start, goal_state=goal
        )

    @property
    def action(self) -> Any:
        return self._texts.action

    @property
    def transition(self) -> str:
        return str(self._texts.transition)

    @property
    def start_state(self) -> str:
        return str(self._texts.start_state)

    @property
    def goal_state(self) -> str:
        return str(self._texts.goal_state)


CONFIGURED = Transition(FIRST, "on_configure_success", "configuring", "inactive")
ACTIVE = Transition(FIRST, "on_activate_success", "activating", "active")
OTHER = Transition(SECOND, "on_configure_success", "configuring", "inactive")


@pytest.mark.parametrize(
    ("wanted", "taken"),
    [
        ({}, [CONFIGURED, ACTIVE, OTHER]),
        ({"target_lifecycle_node": FIRST}, [CONFIGURED, ACTIVE]),
        ({"transition": "on_configure_success"}, [CONFIGURED, OTHER]),
        ({"goal_state": "active"}, [ACTIVE]),
        ({"start_state": "configuring", "goal_state": "inactive"}, [CONFIGURED, OTHER]),
        ({"start_state": "configuring", "goal_state": "active"}, []),
        ({"target_lifecycle_node": SECOND, "goal_state": "inactive"}, [OTHER]),
    ],
)
def test_which_it_takes(wanted: dict[str, Any], taken: list[Transition]) -> None:
    handler = OnStateTransition(entities=[], **wanted)
    assert [one for one in (CONFIGURED, ACTIVE, OTHER) if handler.matches(one)] == taken


def test_what_it_answers_and_what_can_not_be_made() -> None:
    entities: Any = [object()]
    assert OnStateTransition(entities=entities).handle(ACTIVE, LaunchContext()) is entities
    with pytest.raises(ValueError, match="either a transition, or start_state and goal_state"):
        OnStateTransition(entities=[], transition="activate", goal_state="active")
