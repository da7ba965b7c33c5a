"""Actions for tests; programs import it as `launch_testing.actions`."""

import asyncio
import sys
from collections.abc import Sequence
from typing import Any

from bus_launch.launch.action import Action
from bus_launch.launch.actions import EmitEvent, ExecuteProcess, TimerAction
from bus_launch.launch.core import LaunchContext, LaunchDescriptionEntity, SomeSubstitutionsType
from bus_launch.launch.event_handlers import OnProcessExit, OnShutdown
from bus_launch.launch.events import Shutdown, matches_action
from bus_launch.launch.events.process import ShutdownProcess
from bus_launch.launch.frontend import Entity, Parser, expose_action

__all__ = ["GTest", "PyTest", "ReadyToTest", "Test", "ready_actions"]

__path__: list[str] = []  # there may be modules in it: a file for each class, as in ROS 2


@expose_action("ready_to_test")
class ReadyToTest(Action):
    """The tests may begin. The launch goes on until they have ended."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._callbacks: list[Any] = []
        self._done: asyncio.Future[None] | None = None

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> tuple[type[Action], dict[str, Any]]:
        return cls, super().parse(entity, parser)[1]

    def _add_callback(self, callback: Any) -> None:
        self._callbacks.append(callback)

    def execute(self, context: LaunchContext) -> None:
        assert context.asyncio_loop is not None
        self._done = context.asyncio_loop.create_future()
        context.register_event_handler(OnShutdown(on_shutdown=self._end))
        for callback in self._callbacks:
            callback()

    def _end(self, event: Shutdown, context: LaunchContext) -> None:
        if self._done is not None and not self._done.done():
            self._done.set_result(None)

    def get_asyncio_future(self) -> "asyncio.Future[None] | None":
        return self._done


def ready_actions(entity: LaunchDescriptionEntity) -> list[ReadyToTest]:
    """All ReadyToTest actions of a description, as far as they are known before it runs."""
    found = [entity] if isinstance(entity, ReadyToTest) else []
    below = list(entity.describe_sub_entities())
    for _, others in entity.describe_conditional_sub_entities():
        below += others
    for one in below:
        found += ready_actions(one)
    return found


class Test(ExecuteProcess):
    """A process that is a test: after `timeout` seconds it is ended, by SIGINT first."""

    __test__ = False  # for pytest, a test file that imports it has no more tests

    def __init__(
        self,
        *,
        timeout: float | SomeSubstitutionsType | None = None,
        kill_timeout: float | SomeSubstitutionsType = 5.0,
        **kwargs: Any,
    ) -> None:
        """`kill_timeout`: seconds from SIGINT to SIGTERM."""
        given = str(kill_timeout) if isinstance(kill_timeout, int | float) else kill_timeout
        super().__init__(**{"sigterm_timeout": given, **kwargs})
        self.__timeout = timeout

    @property
    def timeout(self) -> float | SomeSubstitutionsType | None:
        return self.__timeout

    def execute(self, context: LaunchContext) -> Sequence[LaunchDescriptionEntity] | None:
        found = super().execute(context)
        if self.__timeout is None:
            return found
        end = EmitEvent(event=ShutdownProcess(process_matcher=matches_action(self)))
        timer = TimerAction(period=self.__timeout, actions=[end])
        context.register_event_handler(
            OnProcessExit(target_action=self, on_exit=lambda event, context: timer.cancel())
        )
        return [*(found or ()), timer]


class GTest(Test):
    """A program that is a test, such as one of GoogleTest."""

    def __init__(self, *, path: SomeSubstitutionsType, **kwargs: Any) -> None:
        super().__init__(cmd=[path], **kwargs)
        self.__path = path

    @property
    def path(self) -> SomeSubstitutionsType:
        return self.__path


class PyTest(Test):
    """A file or folder of tests for pytest."""

    def __init__(self, *, path: SomeSubstitutionsType, **kwargs: Any) -> None:
        super().__init__(cmd=[sys.executable, "-m", "pytest", path], **kwargs)
        self.__path = path

    @property
    def path(self) -> SomeSubstitutionsType:
        return self.__path
