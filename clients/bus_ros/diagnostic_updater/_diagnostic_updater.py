"""Tasks that check a node's health, and the updater that runs them and publishes their results."""

import threading
from collections.abc import Callable, Iterable
from typing import Any

from bus_ros.diagnostic_updater._diagnostic_status_wrapper import DiagnosticStatusWrapper
from bus_ros.rclpy.node import Node
from bus_ros.rosidl import message_class

__all__ = [
    "CompositeDiagnosticTask",
    "DiagnosticTask",
    "DiagnosticTaskVector",
    "FunctionDiagnosticTask",
    "Updater",
]

_DiagnosticArray: Any = message_class("diagnostic_msgs/msg/DiagnosticArray")
_DiagnosticStatus: Any = message_class("diagnostic_msgs/msg/DiagnosticStatus")
_OK: bytes = _DiagnosticStatus.OK

Run = Callable[[DiagnosticStatusWrapper], DiagnosticStatusWrapper | None]


class DiagnosticTask:
    """A check. Subclasses define `run`."""

    def __init__(self, name: str) -> None:
        self.name = name

    def getName(self) -> str:
        return self.name

    def run(self, stat: DiagnosticStatusWrapper) -> DiagnosticStatusWrapper:
        """Fill in a status, and return it."""
        return stat


class FunctionDiagnosticTask(DiagnosticTask):
    """A task that is a function."""

    def __init__(self, name: str, fn: Run) -> None:
        super().__init__(name)
        self.fn = fn

    def run(self, stat: DiagnosticStatusWrapper) -> DiagnosticStatusWrapper:
        return _run(self.fn, stat)


class CompositeDiagnosticTask(DiagnosticTask):
    """Several tasks with one status: the highest level, and the messages of all tasks that are not OK."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.tasks: list[DiagnosticTask] = []

    def run(self, stat: DiagnosticStatusWrapper) -> DiagnosticStatusWrapper:
        original, combined = DiagnosticStatusWrapper(), DiagnosticStatusWrapper()
        original.summary(stat)
        for task in self.tasks:
            stat.summary(original)
            stat = _run(task.run, stat)
            combined.mergeSummary(stat)
        stat.summary(combined)
        return stat

    def addTask(self, t: DiagnosticTask) -> None:
        self.tasks.append(t)


class DiagnosticTaskVector:
    """Tasks by name, in the order in which they were added. May be used from any thread."""

    def __init__(self) -> None:
        self.tasks: list[FunctionDiagnosticTask] = []
        self.lock = threading.Lock()

    def addedTaskCallback(self, task: FunctionDiagnosticTask) -> None:
        """Called with each added task; for subclasses."""

    def add(self, *args: Any) -> None:
        """Add a task: `add(task)`, or `add(name, function)`. Raises TypeError for anything else."""
        if len(args) == 1:
            args = args[0].getName(), args[0].run
        if len(args) != 2:
            raise TypeError(f"add() takes a task, or a name and a function, not {len(args)} arguments")
        task = FunctionDiagnosticTask(*args)
        with self.lock:
            self.tasks.append(task)
        self.addedTaskCallback(task)

    def removeByName(self, name: str) -> bool:
        """Remove the first task of that name; returns whether there was one."""
        with self.lock:
            for task in self.tasks:
                if task.name == name:
                    self.tasks.remove(task)
                    return True
        return False


class Updater(DiagnosticTaskVector):
    """Runs tasks each `period` seconds while its node is spun, and publishes their statuses on /diagnostics.

    If the node's parameters `diagnostic_updater.period` and `diagnostic_updater.use_fqn` (names with the
    node's namespace) are set, they count. A status that a task does not fill in is an error.
    """

    def __init__(self, node: Node, period: float = 1.0) -> None:
        super().__init__()
        self.node = node
        self.publisher = node.create_publisher(_DiagnosticArray, "/diagnostics", 1)
        self.period_parameter = "diagnostic_updater.period"
        self._period = float(_parameter(node, self.period_parameter, period))
        is_full = _parameter(node, "diagnostic_updater.use_fqn", False)
        self._node_name = node.get_fully_qualified_name() if is_full else node.get_name()
        self.timer = node.create_timer(self._period, self.update)
        self.verbose = False
        self.hwid = ""
        self.warn_nohwid_done = False

    @property
    def period(self) -> float:
        """Seconds between updates; setting it starts a new period."""
        return self._period

    @period.setter
    def period(self, period: float) -> None:
        self._period = period
        self.node.destroy_timer(self.timer)
        self.timer = self.node.create_timer(period, self.update)

    def setHardwareID(self, hwid: str) -> None:
        """The hardware of all statuses; `none` if there is none."""
        self.hwid = hwid

    def update(self) -> None:
        """Run all tasks and publish. An exception of a task ends it: nothing is published."""
        statuses = [self._status_of(task) for task in self._all()]
        if self.verbose:
            for status in statuses:
                if status.level != _OK:
                    self.node.get_logger().warning(
                        f"Non-zero diagnostic status. Name: {status.name}, "
                        f"status {status.level!r}: {status.message}"
                    )
        if not (self.hwid or self.warn_nohwid_done or any(status.level != _OK for status in statuses)):
            self.warn_nohwid_done = True
            self.node.get_logger().warning(
                "diagnostic_updater: No HW_ID was set. This is probably a bug. Please report it. For devices "
                "that do not have a HW_ID, set this value to none. This warning only occurs once all "
                "diagnostics are OK so it is okay to wait until the device is open before calling "
                "setHardwareID."
            )
        self.publish(statuses)

    def force_update(self) -> None:
        """Run all tasks and publish now; the period is not restarted."""
        self.update()

    def broadcast(self, lvl: bytes, msg: str) -> None:
        """Publish one level and message for all tasks, for example before a shutdown."""
        statuses = [DiagnosticStatusWrapper(name=task.name) for task in self._all()]
        for status in statuses:
            status.summary(lvl, msg)
        self.publish(statuses)

    def publish(self, msg: Any) -> None:
        """Publish a status, or a list of them, with the node's name in front of their names."""
        array = _DiagnosticArray(
            status=[self._named(one) for one in (msg if isinstance(msg, list) else [msg])]
        )
        array.header.stamp = self.node.get_clock().now().to_msg()
        self.publisher.publish(array)

    def addedTaskCallback(self, task: FunctionDiagnosticTask) -> None:
        self.publish(DiagnosticStatusWrapper(name=task.name, level=_OK, message="Node starting up"))

    def _all(self) -> Iterable[FunctionDiagnosticTask]:
        with self.lock:
            return tuple(self.tasks)

    def _status_of(self, task: FunctionDiagnosticTask) -> DiagnosticStatusWrapper:
        status = DiagnosticStatusWrapper(
            level=_DiagnosticStatus.ERROR,
            name=task.name,
            message="No message was set",
            hardware_id=self.hwid,
        )
        return task.run(status)

    def _named(self, status: Any) -> Any:
        return _DiagnosticStatus(
            level=status.level,
            name=f"{self._node_name}: {status.name}",
            message=status.message,
            hardware_id=status.hardware_id,
            values=status.values,
        )


def _run(function: Run, stat: DiagnosticStatusWrapper) -> DiagnosticStatusWrapper:
    """The result of a function, or the given status if the function does not return it."""
    found = function(stat)
    return stat if found is None else found


def _parameter(node: Node, name: str, default: Any) -> Any:
    """The parameter's value in the node, from inside or outside; all updaters of a node share it."""
    if node.has_parameter(name):
        return node.get_parameter(name).value
    return node.declare_parameter(name, default).value
