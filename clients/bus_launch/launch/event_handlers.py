"""Handlers of the events of a launch; programs import them as `launch.event_handlers`."""

from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

from bus_launch.launch.core import (
    BaseEventHandler,
    Event,
    LaunchContext,
    LaunchDescriptionEntity,
    SomeEntitiesType,
    normalize_to_list_of_entities,
)
from bus_launch.launch.events import ExecutionComplete, IncludeLaunchDescription, Shutdown
from bus_launch.launch.events.process import (
    ProcessExited,
    ProcessIO,
    ProcessStarted,
)

__all__ = [
    "OnActionEventBase",
    "OnExecutionComplete",
    "OnIncludeLaunchDescription",
    "OnProcessExit",
    "OnProcessIO",
    "OnProcessStart",
    "OnShutdown",
]

__path__: list[str] = []  # there may be modules in it: a file for each class, as in ROS 2

_Target: TypeAlias = LaunchDescriptionEntity | Callable[[Any], bool] | None
_Answer: TypeAlias = SomeEntitiesType | Callable[..., SomeEntitiesType | None] | None


class OnActionEventBase(BaseEventHandler):
    """For events of one action, of actions that a function accepts, or of any action.

    `on_event`: the entities to visit then, or a function of the event and the context that returns them.
    """

    def __init__(
        self,
        *,
        action_matcher: _Target,
        on_event: _Answer,
        target_event_cls: type[Event],
        target_action_cls: type[LaunchDescriptionEntity] = LaunchDescriptionEntity,
        handle_once: bool = False,
    ) -> None:
        if (
            action_matcher is not None
            and not callable(action_matcher)
            and not isinstance(action_matcher, target_action_cls)
        ):
            raise TypeError(
                f"{type(self).__name__} requires a '{target_action_cls.__name__}' instance or a callable "
                f"as target_action, got {action_matcher!r}"
            )
        super().__init__(matcher=self.__takes, handle_once=handle_once)
        self.__target = action_matcher
        self.__event_class = target_event_cls
        self.__call, self.__entities = _split(on_event)

    def __takes(self, event: Event) -> bool:
        if not isinstance(event, self.__event_class):
            return False
        action = event.action  # type: ignore[attr-defined]
        if self.__target is None:
            return True
        return bool(self.__target(action)) if callable(self.__target) else action is self.__target

    def handle(self, event: Event, context: LaunchContext) -> SomeEntitiesType | None:
        super().handle(event, context)
        return self.__entities if self.__call is None else self.__call(event, context)

    @property
    def handler_description(self) -> str:
        return "<actions>" if self.__call is None else str(self.__call)

    @property
    def matcher_description(self) -> str:
        return f"event == {self.__event_class.__name__}"

    def describe(self) -> tuple[str, list[LaunchDescriptionEntity]]:
        return super().describe()[0], list(self.__entities)


class OnExecutionComplete(OnActionEventBase):
    """An action has done its work."""

    def __init__(
        self,
        *,
        target_action: _Target = None,
        on_completion: _Answer,
        handle_once: bool = False,
    ) -> None:
        super().__init__(
            action_matcher=target_action,
            on_event=on_completion,
            target_event_cls=ExecutionComplete,
            handle_once=handle_once,
        )


class OnProcessStart(OnActionEventBase):
    """A process has been started."""

    def __init__(
        self, *, target_action: _Target = None, on_start: _Answer, handle_once: bool = False
    ) -> None:
        super().__init__(
            action_matcher=target_action,
            on_event=on_start,
            target_event_cls=ProcessStarted,
            handle_once=handle_once,
        )


class OnProcessExit(OnActionEventBase):
    """A process has ended."""

    def __init__(
        self, *, target_action: _Target = None, on_exit: _Answer = None, handle_once: bool = False
    ) -> None:
        super().__init__(
            action_matcher=target_action,
            on_event=on_exit,
            target_event_cls=ProcessExited,
            handle_once=handle_once,
        )


class OnProcessIO(OnActionEventBase):
    """A process has written something, or is given something to read."""

    def __init__(
        self,
        *,
        target_action: _Target = None,
        on_stdin: Callable[[ProcessIO], SomeEntitiesType | None] | None = None,
        on_stdout: Callable[[ProcessIO], SomeEntitiesType | None] | None = None,
        on_stderr: Callable[[ProcessIO], SomeEntitiesType | None] | None = None,
        handle_once: bool = False,
    ) -> None:
        def on_event(event: ProcessIO, context: LaunchContext) -> SomeEntitiesType | None:
            call = on_stdout if event.from_stdout else on_stderr if event.from_stderr else on_stdin
            return None if call is None else call(event)

        super().__init__(
            action_matcher=target_action,
            on_event=on_event,
            target_event_cls=ProcessIO,
            handle_once=handle_once,
        )


class OnShutdown(BaseEventHandler):
    """The launch ends."""

    def __init__(self, *, on_shutdown: _Answer, handle_once: bool = False) -> None:
        super().__init__(matcher=lambda event: isinstance(event, Shutdown), handle_once=handle_once)
        self.__call, self.__entities = _split(on_shutdown)

    @property
    def matcher_description(self) -> str:
        return "event is Shutdown"

    def describe(self) -> tuple[str, list[LaunchDescriptionEntity]]:
        return super().describe()[0], list(self.__entities)

    def handle(self, event: Event, context: LaunchContext) -> SomeEntitiesType | None:
        super().handle(event, context)
        return self.__entities if self.__call is None else self.__call(event, context)


class OnIncludeLaunchDescription(BaseEventHandler):
    """Visits the launch description of an IncludeLaunchDescription event."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(matcher=lambda event: isinstance(event, IncludeLaunchDescription), **kwargs)

    def handle(self, event: Event, context: LaunchContext) -> SomeEntitiesType | None:
        super().handle(event, context)
        assert isinstance(event, IncludeLaunchDescription)
        return event.launch_description


def _split(answer: _Answer) -> tuple[Callable[..., Any] | None, list[LaunchDescriptionEntity]]:
    if callable(answer) and not isinstance(answer, LaunchDescriptionEntity):
        return answer, []
    if isinstance(answer, str) or not isinstance(answer, LaunchDescriptionEntity | Iterable | None):
        raise TypeError(f"expected actions or a function of event and context, got {answer!r}")
    return None, normalize_to_list_of_entities(answer)
