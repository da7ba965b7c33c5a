"""The launch of a fixture: starts it, drives its loop while tests run, ends it.

Must not know: pytest.
"""

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

from bus_launch.launch.launch_description import LaunchDescription
from bus_launch.launch.launch_service import LaunchService
from bus_launch.launch_pytest.fixture import LaunchOptions
from bus_launch.launch_testing.actions import ReadyToTest, ready_actions

__all__ = ["LaunchRun"]


class LaunchRun:
    """Made and used in the main thread. `start` once, then tests, then `close`."""

    def __init__(self, options: LaunchOptions) -> None:
        self.loop = asyncio.new_event_loop()
        self.service = LaunchService()
        self._options = options
        self._task: asyncio.Task[int] | None = None

    def start(self, made: object) -> None:
        """Start the launch of the fixture's value `made`; returns when it is ready for tests.

        Raises TypeError for another value. Raises RuntimeError if the launch has several ReadyToTest, or ends
        before it is ready.
        """
        description = made[0] if isinstance(made, Sequence) and made else made
        if not isinstance(description, LaunchDescription):
            raise TypeError(
                f"{self._place()}: return value must be either a launch description or a sequence that "
                f"begins with one, not {made!r}"
            )
        self.loop.run_until_complete(self._begin(description))

    def call(self, function: Callable[[], Any]) -> Any:
        """Call a function in another thread while the launch runs here; raises its exception."""

        def outcome() -> tuple[Any, BaseException | None]:
            try:
                return function(), None
            except BaseException as error:  # for a future with SystemExit, asyncio's loop would never end
                return None, error

        result, error = self.loop.run_until_complete(self.loop.run_in_executor(None, outcome))
        if error is not None:
            raise error
        return result

    def run(self, coroutine: Coroutine[Any, Any, Any]) -> Any:
        """Run a coroutine beside the launch."""
        return self.loop.run_until_complete(coroutine)

    def stop(self) -> None:
        """End the launch, and wait for that. Raises RuntimeError if it failed; no effect after its end."""
        if self._task is None:
            return
        if self._options.auto_shutdown:
            self.service.shutdown()
        task, self._task = self._task, None
        code = self.loop.run_until_complete(task)
        if code:
            raise RuntimeError(
                f"{self._place()}: the launch ended with return code {code}; its log has the error"
            )

    def close(self) -> None:
        """Stop, and close the loop."""
        try:
            self.stop()
        finally:
            self.loop.run_until_complete(self.loop.shutdown_asyncgens())
            self.loop.run_until_complete(self.loop.shutdown_default_executor())
            self.loop.close()

    async def _begin(self, description: LaunchDescription) -> None:
        actions = ready_actions(description)
        if len(actions) > 1:
            raise RuntimeError(
                f"{self._place()}: a launch description must contain only one ReadyToTest action, not "
                f"{len(actions)}"
            )
        if not actions:
            actions = [ReadyToTest()]
            description.add_action(actions[0])
        ready = asyncio.Event()
        actions[0]._add_callback(ready.set)
        self.service.include_launch_description(description)
        self._task = self.loop.create_task(
            self.service.run_async(shutdown_when_idle=self._options.shutdown_when_idle)
        )
        waiting = self.loop.create_task(ready.wait())
        await asyncio.wait([self._task, waiting], return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()
        if not ready.is_set():
            raise RuntimeError(f"{self._place()}: the launch ended before it was ready for tests")

    def _place(self) -> str:
        return f"launch_pytest fixture '{self._options.name}'"
