"""Actions that say something, call something, wait, or handle events."""

import asyncio
from collections.abc import Callable, Coroutine, Iterable, Mapping, Sequence
from typing import Any

from bus_launch.launch import logging
from bus_launch.launch.action import Action
from bus_launch.launch.core import (
    BaseEventHandler,
    Event,
    EventHandler,
    LaunchContext,
    LaunchDescriptionEntity,
    SomeSubstitutionsType,
    Substitution,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.event_handlers import OnShutdown
from bus_launch.launch.events import Shutdown as ShutdownEvent
from bus_launch.launch.events import TimerEvent
from bus_launch.launch.events.process import ProcessExited
from bus_launch.launch.frontend import Entity, Parser, expose_action
from bus_launch.launch.utilities.type_utils import perform_typed_substitution

__all__ = [
    "EmitEvent",
    "LogInfo",
    "OpaqueCoroutine",
    "OpaqueFunction",
    "RegisterEventHandler",
    "Shutdown",
    "TimerAction",
    "UnregisterEventHandler",
    "seconds",
]

_Parsed = tuple[type[Action], dict[str, Any]]
_Found = Sequence[LaunchDescriptionEntity] | None


@expose_action("log")
class LogInfo(Action):
    """Prints a line: `[INFO] [launch.user]: ...`."""

    def __init__(self, *, msg: SomeSubstitutionsType, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__msg = normalize_to_list_of_substitutions(msg)

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        _, kwargs = super().parse(entity, parser)
        entity.get_attr("level", optional=True)
        kwargs["msg"] = parser.parse_substitution(entity.get_attr("message"))
        return cls, kwargs

    @property
    def msg(self) -> list[Substitution]:
        return self.__msg

    def execute(self, context: LaunchContext) -> None:
        logging.get_logger("launch.user").info(perform_substitutions(context, self.__msg))


class EmitEvent(Action):
    """Puts an event into the queue."""

    def __init__(self, *, event: Event, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        if not isinstance(event, Event):
            raise RuntimeError(f"EmitEvent() expected an event instance, got '{event}'")
        self.__event = event

    @property
    def event(self) -> Event:
        return self.__event

    def execute(self, context: LaunchContext) -> None:
        context.emit_event_sync(self.__event)


@expose_action("shutdown")
class Shutdown(EmitEvent):
    """Ends the launch."""

    def __init__(self, *, reason: SomeSubstitutionsType = "reason not given", **kwargs: Any) -> None:
        super().__init__(event=ShutdownEvent(reason=str(reason)), **kwargs)

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        _, kwargs = super().parse(entity, parser)
        reason = entity.get_attr("reason", optional=True)
        if reason is not None:
            kwargs["reason"] = parser.escape_characters(reason)
        return cls, kwargs

    def execute(self, context: LaunchContext) -> None:
        event = context.get_locals_as_dict().get("event")
        if isinstance(event, ProcessExited) and not context.is_shutdown:
            logging.get_logger("launch").info(
                f"process[{event.process_name}] was required: shutting down launched system"
            )
        super().execute(context)


class OpaqueFunction(Action):
    """Calls a function of the context; the launch visits the returned entities next."""

    def __init__(
        self,
        *,
        function: Callable[..., _Found],
        args: Iterable[Any] | None = None,
        kwargs: Mapping[str, Any] | None = None,
        **left_over_kwargs: Any,
    ) -> None:
        super().__init__(**left_over_kwargs)
        if not callable(function):
            raise TypeError(f"OpaqueFunction expected a function, got {function!r}")
        self.__function = function
        self.__args = list(args or ())
        self.__kwargs = dict(kwargs or {})

    def execute(self, context: LaunchContext) -> _Found:
        return self.__function(context, *self.__args, **self.__kwargs)


class OpaqueCoroutine(Action):
    """Runs a coroutine function beside the launch, which goes on until it is done; cancelled at shutdown."""

    def __init__(
        self,
        *,
        coroutine: Callable[..., Coroutine[Any, Any, None]],
        args: Iterable[Any] | None = None,
        kwargs: Mapping[str, Any] | None = None,
        ignore_context: bool = False,
        **left_over_kwargs: Any,
    ) -> None:
        super().__init__(**left_over_kwargs)
        if not asyncio.iscoroutinefunction(coroutine):
            raise TypeError("OpaqueCoroutine expected a coroutine function, got " + repr(coroutine))
        self.__coroutine = coroutine
        self.__args = list(args or ())
        self.__kwargs = dict(kwargs or {})
        self.__ignore_context = ignore_context
        self.__future: asyncio.Future[None] | None = None

    def execute(self, context: LaunchContext) -> None:
        first = () if self.__ignore_context else (context,)
        assert context.asyncio_loop is not None
        task = context.asyncio_loop.create_task(self.__coroutine(*first, *self.__args, **self.__kwargs))
        self.__future = task
        context.register_event_handler(OnShutdown(on_shutdown=lambda event, context: _cancel(task)))

    def get_asyncio_future(self) -> "asyncio.Future[None] | None":
        return self.__future


def _cancel(task: "asyncio.Task[None]") -> None:
    task.cancel()


@expose_action("timer")
class TimerAction(Action):
    """Visits actions after a period, in seconds."""

    def __init__(
        self,
        *,
        period: float | SomeSubstitutionsType,
        actions: Iterable[LaunchDescriptionEntity],
        cancel_on_shutdown: bool | SomeSubstitutionsType = True,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.__period: float | list[Substitution] = (
            float(period) if isinstance(period, int | float) else normalize_to_list_of_substitutions(period)
        )
        self.__actions = list(actions)
        self.__cancel_on_shutdown: bool | list[Substitution] = (
            cancel_on_shutdown
            if isinstance(cancel_on_shutdown, bool)
            else normalize_to_list_of_substitutions(cancel_on_shutdown)
        )
        self.__timer: asyncio.TimerHandle | None = None
        self.__done: asyncio.Future[None] | None = None

    @classmethod
    def parse(cls, entity: Entity, parser: Parser) -> _Parsed:
        _, kwargs = super().parse(entity, parser)
        kwargs["period"] = parser.parse_if_substitutions(entity.get_attr("period", data_type=float))
        kwargs["actions"] = [parser.parse_action(child) for child in entity.children]
        return cls, kwargs

    @property
    def period(self) -> float | list[Substitution]:
        return self.__period

    @property
    def actions(self) -> list[LaunchDescriptionEntity]:
        return self.__actions

    def describe_conditional_sub_entities(
        self,
    ) -> list[tuple[str, Iterable[LaunchDescriptionEntity]]]:
        period = self.__period
        text = str(period) if isinstance(period, float) else " + ".join(one.describe() for one in period)
        return [(f"after {text} s", self.__actions)]

    def execute(self, context: LaunchContext) -> None:
        loop = context.asyncio_loop
        assert loop is not None
        is_cancelled = perform_typed_substitution(context, self.__cancel_on_shutdown, bool)
        if context.is_shutdown and is_cancelled:
            return
        self.__done = loop.create_future()
        later = OpaqueFunction(function=self.__begin, args=[context.get_locals_as_dict()])
        expired = EventHandler(matcher=self.__is_mine, entities=later, handle_once=True)
        context.register_event_handler(expired)
        if is_cancelled:
            context.register_event_handler(OnShutdown(on_shutdown=lambda event, context: self.cancel()))
        self.__timer = loop.call_later(seconds(context, self.__period), self.__expire, context)

    def __begin(self, context: LaunchContext, values: Mapping[str, Any]) -> _Found:
        """Its actions see what they would have seen at once: their file, an outer handler's event."""
        context.extend_locals(values)
        return self.__actions

    def __is_mine(self, event: Event) -> bool:
        return isinstance(event, TimerEvent) and event.timer_action is self

    def __expire(self, context: LaunchContext) -> None:
        context.emit_event_sync(TimerEvent(timer_action=self))
        self.cancel()

    def cancel(self) -> None:
        """Its actions are not visited any more."""
        if self.__timer is not None:
            self.__timer.cancel()
        if self.__done is not None and not self.__done.done():
            self.__done.set_result(None)

    def get_asyncio_future(self) -> "asyncio.Future[None] | None":
        return self.__done


def seconds(context: LaunchContext, period: float | list[Substitution]) -> float:
    """Raises ValueError if the text is no number, or below zero."""
    text = str(period) if isinstance(period, float) else perform_substitutions(context, period)
    try:
        found = float(text)
    except ValueError:
        found = -1.0
    if not 0 <= found < float("inf"):
        raise ValueError(f"a period must be a number of seconds, not '{text}'")
    return found


class RegisterEventHandler(Action):
    """Has events handled from now on."""

    def __init__(self, event_handler: BaseEventHandler, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__event_handler = event_handler

    @property
    def event_handler(self) -> BaseEventHandler:
        return self.__event_handler

    def describe_conditional_sub_entities(
        self,
    ) -> list[tuple[str, Iterable[LaunchDescriptionEntity]]]:
        text, entities = self.__event_handler.describe()
        return [(text, entities)] if entities else []

    def execute(self, context: LaunchContext) -> None:
        context.register_event_handler(self.__event_handler)


class UnregisterEventHandler(Action):
    """Has events handled no longer."""

    def __init__(self, event_handler: BaseEventHandler, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__event_handler = event_handler

    @property
    def event_handler(self) -> BaseEventHandler:
        return self.__event_handler

    def execute(self, context: LaunchContext) -> None:
        context.unregister_event_handler(self.__event_handler)
