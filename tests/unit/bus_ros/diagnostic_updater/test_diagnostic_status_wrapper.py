"""A status that several tasks fill in."""

from typing import Any

from bus_ros.diagnostic_updater import DiagnosticStatusWrapper
from bus_ros.rosidl import message_class
from rows import for_each

DiagnosticStatus: Any = message_class("diagnostic_msgs/msg/DiagnosticStatus")
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


def test_summary_and_values() -> None:
    status = DiagnosticStatusWrapper(name="motor")
    status.summary(WARN, 7)
    assert (status.level, status.message, status.name) == (WARN, "7", "motor")
    status.summary(DiagnosticStatus(level=ERROR, message="hot"))
    assert (status.level, status.message) == (ERROR, "hot")
    status.clearSummary()
    assert (status.level, status.message) == (OK, "")
    status.add("celsius", 40.5)
    status.add("on", True)
    assert [(one.key, one.value) for one in status.values] == [("celsius", "40.5"), ("on", "True")]


@for_each(
    ("first", "second", "merged"),
    [
        ((OK, "fine"), (WARN, "warm"), (WARN, "warm")),
        ((WARN, "warm"), (OK, "fine"), (WARN, "warm")),
        ((WARN, "warm"), (ERROR, "hot"), (ERROR, "warm; hot")),
        ((ERROR, "hot"), (WARN, "warm"), (ERROR, "hot; warm")),
        ((OK, "fine"), (OK, "cool"), (OK, "fine; cool")),
        ((OK, ""), (OK, "cool"), (OK, "cool")),
    ],
)
def test_merging(first: Any, second: Any, merged: Any) -> None:
    for args in (second, (DiagnosticStatus(level=second[0], message=second[1]),)):
        status = DiagnosticStatusWrapper()
        status.summary(*first)
        status.mergeSummary(*args)
        assert (status.level, status.message) == merged
