"""`diagnostic_updater` on the bus: a node's reports about its health on `/diagnostics`.

_diagnostic_updater.py has tasks and the `Updater` that runs and publishes them, _update_functions.py tasks
that watch rates and stamps, _publisher.py tasks for a topic, _diagnostic_status_wrapper.py the status.

Invariants: names, parameters and texts are the same as in ROS 2's package, because dashboards compare them.

Read first: `_diagnostic_updater.py`. Tests: `tests/unit/bus_ros/diagnostic_updater/`,
`tests/system/test_diagnostic_updater.py`.
"""

from bus_ros.diagnostic_updater._diagnostic_status_wrapper import DiagnosticStatusWrapper
from bus_ros.diagnostic_updater._diagnostic_updater import (
    CompositeDiagnosticTask,
    DiagnosticTask,
    DiagnosticTaskVector,
    FunctionDiagnosticTask,
    Updater,
)
from bus_ros.diagnostic_updater._publisher import (
    DiagnosedPublisher,
    HeaderlessTopicDiagnostic,
    TopicDiagnostic,
)
from bus_ros.diagnostic_updater._update_functions import (
    FrequencyStatus,
    FrequencyStatusParam,
    Heartbeat,
    TimeStampStatus,
    TimeStampStatusParam,
)

__all__ = [
    "CompositeDiagnosticTask",
    "DiagnosedPublisher",
    "DiagnosticStatusWrapper",
    "DiagnosticTask",
    "DiagnosticTaskVector",
    "FrequencyStatus",
    "FrequencyStatusParam",
    "FunctionDiagnosticTask",
    "HeaderlessTopicDiagnostic",
    "Heartbeat",
    "TimeStampStatus",
    "TimeStampStatusParam",
    "TopicDiagnostic",
    "Updater",
]
