"""The life of an action's process: its states, the events, and which state follows. Pure.

                  +--------- RESTART --------+
                  v                          |
    (execute) -> STARTING -- START --> RUNNING -- EXIT --> WAITING -- GIVE_UP, END --> ENDED
                  |                      |                                               ^
                  END                    END                                             |
                  v                      v                                               |
                 UNWANTED -- START --> ENDING -- EXIT -----------------------------------+

A process that can't be started has EXIT instead of START.
"""

from collections.abc import Mapping
from enum import Enum

__all__ = ["PROCESSES", "ProcessError", "ProcessEvent", "ProcessState", "next_state"]


class ProcessState(Enum):
    """The state of an executed action's process."""

    STARTING = "starting"
    """The process will be started in the next turn of the event loop."""
    UNWANTED = "unwanted"
    """The same, and it is to end as soon as it has started."""
    RUNNING = "running"
    ENDING = "ending"
    """It was sent SIGINT; SIGTERM and SIGKILL follow if it does not end."""
    WAITING = "waiting"
    """It has ended by itself, or could not be started; perhaps it is started again after a delay."""
    ENDED = "ended"
    """It has ended for good."""


class ProcessEvent(Enum):
    """What happens to it."""

    START = "start"
    """The process runs."""
    EXIT = "exit"
    """The process has ended, or could not be started."""
    END = "end"
    """The process is to end: the launch shuts down, or a ShutdownProcess event means it."""
    RESTART = "restart"
    """The delay before the next start is over."""
    GIVE_UP = "give up"
    """It is not to be started again."""


class ProcessError(Exception):
    """An event came in a state in which it can't happen: a bug of `launch`."""


PROCESSES: Mapping[ProcessState, Mapping[ProcessEvent, ProcessState]] = {
    ProcessState.STARTING: {
        ProcessEvent.START: ProcessState.RUNNING,
        ProcessEvent.EXIT: ProcessState.WAITING,
        ProcessEvent.END: ProcessState.UNWANTED,
    },
    ProcessState.UNWANTED: {
        ProcessEvent.START: ProcessState.ENDING,
        ProcessEvent.EXIT: ProcessState.ENDED,
        ProcessEvent.END: ProcessState.UNWANTED,
    },
    ProcessState.RUNNING: {
        ProcessEvent.EXIT: ProcessState.WAITING,
        ProcessEvent.END: ProcessState.ENDING,
    },
    ProcessState.ENDING: {
        ProcessEvent.EXIT: ProcessState.ENDED,
        ProcessEvent.END: ProcessState.ENDING,
    },
    ProcessState.WAITING: {
        ProcessEvent.RESTART: ProcessState.STARTING,
        ProcessEvent.GIVE_UP: ProcessState.ENDED,
        ProcessEvent.END: ProcessState.ENDED,
    },
    ProcessState.ENDED: {ProcessEvent.END: ProcessState.ENDED},
}
"""The next state, by state and event; an event that is not in a state's row must not happen there."""


def next_state(state: ProcessState, event: ProcessEvent) -> ProcessState:
    """Raises ProcessError if the table has no next state."""
    try:
        return PROCESSES[state][event]
    except KeyError:
        raise ProcessError(f"the process is {state.value!r}: {event.value!r} can't happen to it") from None
