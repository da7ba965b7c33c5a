"""Each cell of the table of a lifecycle node's states, as on the page, and the ids of lifecycle_msgs."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from bus_ros.rclpy.exceptions import RCLError
from bus_ros.rclpy.impl.transition_callback_return import TransitionCallbackReturnType
from bus_ros.rclpy.lifecycle.state_machine import (
    STATES,
    TRANSITIONS,
    LifecycleStateMachine,
    Transition,
)
from bus_ros.rosidl import message_class

PAGE = (Path(__file__).parents[5] / "docs" / "lifecycle.md").read_text()
(HEAD,) = re.findall(r"^\| state \| (.*) \|$", PAGE, re.MULTILINE)
LABELS = HEAD.split(" | ")
NOT_REGISTERED = "Failed to trigger lifecycle state machine transition: Transition is not registered."


def drawn() -> dict[tuple[int, str], Transition]:
    """The cells of the table on the page, by state and label."""
    ids = {label: number for number, label in STATES.items()}
    found = {}
    rows = re.findall(r"^\| (\w+) \[(\d+)\] \|(.*)\|$", PAGE, re.MULTILINE)
    assert [(int(number), label) for label, number, _ in rows] == list(STATES.items())
    for _, number, cells in rows:
        for label, cell in zip(LABELS, cells.split("|"), strict=True):
            if cell.strip():
                transition, goal = cell.split(": ")
                found[int(number), label] = Transition(int(transition), label, int(number), ids[goal.strip()])
    return found


@pytest.fixture
def told() -> list[Transition]:
    return []


@pytest.fixture
def warned() -> list[str]:
    return []


def at(
    state: int, on_transition: Callable[[Transition], object] = print, warn: Callable[[str], object] = print
) -> LifecycleStateMachine:
    """A machine in that state."""
    machine = LifecycleStateMachine(on_transition, warn)
    machine._state = state
    return machine


def test_every_cell_of_the_table(told: list[Transition], warned: list[str]) -> None:
    cells = drawn()
    for state, name in STATES.items():
        for label in LABELS:
            machine, expected = at(state, told.append, warned.append), cells.get((state, label))
            if expected is None:
                with pytest.raises(RCLError, match=NOT_REGISTERED):
                    machine.trigger_transition_by_label(label)
                with pytest.raises(RCLError, match="Failed to get transition from label"):
                    machine.get_transition_by_label(label)
                assert machine.current_state == (state, name)
                said = f"No transition matching {label} found for current state {name}"
                assert (told, warned) == ([], [said, said])
                warned.clear()
                continue
            assert machine.get_transition_by_label(label) == expected.id
            machine.trigger_transition_by_label(label)
            assert machine.current_state == (expected.goal, STATES[expected.goal])
            assert (told, warned) == ([expected], [])
            told.clear()


def test_every_id_in_every_state(warned: list[str]) -> None:
    by_id = {(one.start, one.id): one for one in drawn().values()}
    for state in STATES:
        for number in range(256):
            machine = at(state, warn=warned.append)
            if (state, number) not in by_id or state >= 10:
                with pytest.raises(RCLError, match=NOT_REGISTERED):
                    machine.begin_transition_by_id(number)
                assert machine.current_state[0] == state
                warned.pop()
            if expected := by_id.get((state, number)):
                machine.trigger_transition_by_id(number, False)  # otherwise it would call print
                assert machine.current_state[0] == expected.goal
            else:
                with pytest.raises(RCLError, match=NOT_REGISTERED):
                    machine.trigger_transition_by_id(number)
                assert (
                    warned.pop() == f"No transition matching {number} found for current state {STATES[state]}"
                )


def test_ids_and_labels_are_those_of_lifecycle_msgs() -> None:
    state, transition = (message_class(f"lifecycle_msgs/msg/{name}") for name in ("State", "Transition"))
    for number, label in STATES.items():
        kind = "TRANSITION_STATE" if number >= 10 else "PRIMARY_STATE"
        assert getattr(state, f"{kind}_{label.upper()}") == number
    callbacks = {
        10: "CONFIGURE",
        11: "CLEANUP",
        12: "SHUTDOWN",
        13: "ACTIVATE",
        14: "DEACTIVATE",
        15: "ERROR",
    }
    for one in TRANSITIONS:
        label = one.label.upper()
        if one.start in callbacks:
            label = f"ON_{callbacks[one.start]}_{label.removeprefix('TRANSITION_')}"
        elif label == "SHUTDOWN":
            label = f"{STATES[one.start].upper()}_SHUTDOWN"
        assert getattr(transition, f"TRANSITION_{label}") == one.id
    for result in TransitionCallbackReturnType:
        assert getattr(transition, f"TRANSITION_CALLBACK_{result.name}") == int(result) == result.value


def test_what_it_tells_of_itself() -> None:
    machine = at(2)
    assert machine.initialized
    assert machine.available_states == list(STATES.items())
    assert machine.available_transitions == [
        (2, "cleanup", 2, "inactive", 11, "cleaningup"),
        (3, "activate", 2, "inactive", 13, "activating"),
        (6, "shutdown", 2, "inactive", 12, "shuttingdown"),
    ]
    assert len(machine.transition_graph) == 25


def test_what_a_callback_returns() -> None:
    success = TransitionCallbackReturnType.SUCCESS
    assert repr(success) == "<TransitionCallbackReturnType.SUCCESS: 97>"
    assert str(success) == "TransitionCallbackReturnType.SUCCESS"
    assert success != 97  # type: ignore[comparison-overlap]
    assert [one.to_label() for one in TransitionCallbackReturnType] == [
        *("transition_success", "transition_failure", "transition_error")
    ]
