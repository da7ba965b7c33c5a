"""Event handlers for tests; programs import it as `launch_testing.event_handlers`."""

from collections.abc import Iterable
from typing import Any

from bus_launch.launch.core import LaunchDescriptionEntity, normalize_to_list_of_entities
from bus_launch.launch.event_handlers import OnProcessIO
from bus_launch.launch.events.process import ProcessIO

__all__ = ["StdoutReadyListener"]

__path__: list[str] = []  # there may be modules in it: a file for each class, as in ROS 2


class StdoutReadyListener(OnProcessIO):
    """Visits `actions` when a process, or any, has written `ready_txt` to stdout."""

    def __init__(
        self, *, target_action: Any = None, ready_txt: str, actions: Iterable[LaunchDescriptionEntity]
    ) -> None:
        self.__ready_txt = ready_txt
        self.__actions = normalize_to_list_of_entities(actions)
        super().__init__(target_action=target_action, on_stdout=self.__on_stdout)

    def __on_stdout(self, event: ProcessIO) -> list[LaunchDescriptionEntity] | None:
        return self.__actions if self.__ready_txt in event.text.decode(errors="replace") else None

    def describe(self) -> tuple[str, list[LaunchDescriptionEntity]]:
        return super().describe()[0], self.__actions
