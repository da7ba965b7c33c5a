"""The states of a lifecycle node, and the transitions between them.

Pure: owns the table and the current state. Must not know: nodes, services, callbacks, or the reports of
transitions. Numbers and labels are the same as in lifecycle_msgs and in ROS 2's state machine.
"""

from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

from bus_ros.rclpy.exceptions import RCLError

__all__ = [
    "STATES",
    "TRANSITIONS",
    "LifecycleStateMachine",
    "Transition",
]

Description: TypeAlias = tuple[int, str, int, str, int, str]
"""Id and label of a transition, then of its start state, then of its goal state."""


class Transition(NamedTuple):
    """A transition from the state `start` to the state `goal`."""

    id: int
    label: str
    start: int
    goal: int


STATES: Final = {
    0: "unknown",
    1: "unconfigured",
    2: "inactive",
    3: "active",
    4: "finalized",
    10: "configuring",
    11: "cleaningup",
    12: "shuttingdown",
    13: "activating",
    14: "deactivating",
    15: "errorprocessing",
}
"""Labels of states."""
_FIRST_BETWEEN: Final = 10
"""From this number on: states between two others, while a callback runs."""

TRANSITIONS: Final = (
    Transition(1, "configure", 1, 10),
    Transition(10, "transition_success", 10, 2),
    Transition(11, "transition_failure", 10, 1),
    Transition(12, "transition_error", 10, 15),
    Transition(2, "cleanup", 2, 11),
    Transition(20, "transition_success", 11, 1),
    Transition(21, "transition_failure", 11, 2),
    Transition(22, "transition_error", 11, 15),
    Transition(3, "activate", 2, 13),
    Transition(30, "transition_success", 13, 3),
    Transition(31, "transition_failure", 13, 2),
    Transition(32, "transition_error", 13, 15),
    Transition(4, "deactivate", 3, 14),
    Transition(40, "transition_success", 14, 2),
    Transition(41, "transition_failure", 14, 3),
    Transition(42, "transition_error", 14, 15),
    Transition(5, "shutdown", 1, 12),
    Transition(6, "shutdown", 2, 12),
    Transition(7, "shutdown", 3, 12),
    Transition(50, "transition_success", 12, 4),
    Transition(51, "transition_failure", 12, 4),
    Transition(52, "transition_error", 12, 15),
    Transition(60, "transition_success", 15, 1),
    Transition(61, "transition_failure", 15, 4),
    Transition(62, "transition_error", 15, 4),
)
"""In the order of `get_transition_graph`."""


class LifecycleStateMachine:
    """A state machine, unconfigured at first.

    `on_transition` is called after each transition with a notification, `warn` with a text for each
    transition that is not possible now.
    """

    initialized = True

    def __init__(self, on_transition: Callable[[Transition], object], warn: Callable[[str], object]) -> None:
        self._state = 1
        self._on_transition = on_transition
        self._warn = warn

    @property
    def current_state(self) -> tuple[int, str]:
        """Its id and its label."""
        return self._state, STATES[self._state]

    @property
    def available_states(self) -> list[tuple[int, str]]:
        return list(STATES.items())

    @property
    def available_transitions(self) -> list[Description]:
        """The transitions from the current state."""
        return [_described(one) for one in TRANSITIONS if one.start == self._state]

    @property
    def transition_graph(self) -> list[Description]:
        """The transitions from all states."""
        return [_described(one) for one in TRANSITIONS]

    def get_transition_by_label(self, label: str) -> int:
        """The id of a transition from the current state. Raises RCLError if there is none."""
        found = self._find(label)
        if found is None:
            raise RCLError("Failed to get transition from label")
        return found.id

    def begin_transition_by_id(self, transition_id: int) -> None:
        """As `trigger_transition_by_id`, but ends no transition under way: only its callback's result may."""
        self._go(self._find(transition_id, ends=False), True)

    def trigger_transition_by_id(self, transition_id: int, publish_notification: bool = True) -> None:
        """Go to its goal. Raises RCLError if it does not start at the current state."""
        self._go(self._find(transition_id), publish_notification)

    def trigger_transition_by_label(self, label: str, publish_notification: bool = True) -> None:
        """Go to its goal. Raises RCLError if it does not start at the current state."""
        self._go(self._find(label), publish_notification)

    def _find(self, wanted: int | str, *, ends: bool = True) -> Transition | None:
        for one in TRANSITIONS if ends or self._state < _FIRST_BETWEEN else ():
            if one.start == self._state and wanted in (one.id, one.label):
                return one
        self._warn(f"No transition matching {wanted} found for current state {STATES[self._state]}")
        return None

    def _go(self, transition: Transition | None, is_told: bool) -> None:
        if transition is None:
            raise RCLError(
                "Failed to trigger lifecycle state machine transition: Transition is not registered."
            )
        self._state = transition.goal
        if is_told:
            self._on_transition(transition)


def _described(one: Transition) -> Description:
    return one.id, one.label, one.start, STATES[one.start], one.goal, STATES[one.goal]
