"""Actions for tests; programs import it as `launch_testing.actions`."""

import asyncio
from typing import Any

from bus_launch.launch.action import Action
from bus_launch.launch.core import LaunchContext
from bus_launch.launch.event_handlers import OnShutdown
from bus_launch.launch.events import Shutdown
from bus_launch.launch.frontend import Entity, Parser, expose_action

__all__ = ["ReadyToTest"]


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
