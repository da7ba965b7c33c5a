"""The states of a goal, and the events between them: ROS 2's state machine, as a table.

Owns: the table and the text for events that it does not allow. Pure: no I/O, no clock, no messages.

                   +-> EXECUTING --+--> SUCCEEDED
        ACCEPTED --+       |       +--> ABORTED
                   |       v       |
                   +-> CANCELING --+--> CANCELED
"""

from collections.abc import Mapping
from enum import IntEnum
from types import MappingProxyType
from typing import Final

from bus.errors import LocalProtocolError

__all__ = ["TRANSITIONS", "GoalEvent", "GoalStatus", "InvalidTransition", "next_status"]


class GoalStatus(IntEnum):
    """The state of a goal, with the numbers of action_msgs/msg/GoalStatus.

    For example:

        goal.status is GoalStatus.EXECUTING
    """

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6

    @classmethod
    def _missing_(cls, value: object) -> "GoalStatus":
        """UNKNOWN for a number that is not a state: other programs may send one."""
        return cls.UNKNOWN

    @property
    def is_active(self) -> bool:
        """Whether it is accepted and has not ended."""
        return GoalStatus.ACCEPTED <= self <= GoalStatus.CANCELING

    @property
    def is_end(self) -> bool:
        """Whether no other state can follow."""
        return self >= GoalStatus.SUCCEEDED


class GoalEvent(IntEnum):
    """Events that move a goal from one state to the next."""

    EXECUTE = 0
    CANCEL_GOAL = 1
    SUCCEED = 2
    ABORT = 3
    CANCELED = 4


class InvalidTransition(LocalProtocolError):
    """A goal's state does not allow the event: succeeding twice, for example."""

    def __init__(self, status: GoalStatus, event: GoalEvent) -> None:
        super().__init__(
            f"goal_handle attempted invalid transition from state {status.name} with event {event.name}"
        )
        self.status = status
        """The state that the goal is in."""
        self.event = event
        """The event that the state does not allow."""


TRANSITIONS: Final[Mapping[GoalStatus, Mapping[GoalEvent, GoalStatus]]] = MappingProxyType(
    {
        GoalStatus.ACCEPTED: {
            GoalEvent.EXECUTE: GoalStatus.EXECUTING,
            GoalEvent.CANCEL_GOAL: GoalStatus.CANCELING,
        },
        GoalStatus.EXECUTING: {
            GoalEvent.CANCEL_GOAL: GoalStatus.CANCELING,
            GoalEvent.SUCCEED: GoalStatus.SUCCEEDED,
            GoalEvent.ABORT: GoalStatus.ABORTED,
        },
        GoalStatus.CANCELING: {
            GoalEvent.SUCCEED: GoalStatus.SUCCEEDED,
            GoalEvent.ABORT: GoalStatus.ABORTED,
            GoalEvent.CANCELED: GoalStatus.CANCELED,
        },
    }
)
"""State -> event -> next state; a missing event is not allowed."""


def next_status(status: GoalStatus, event: GoalEvent) -> GoalStatus:
    """The state after `event`. Raises InvalidTransition if the table has none."""
    try:
        return TRANSITIONS[status][event]
    except KeyError:
        raise InvalidTransition(status, event) from None
