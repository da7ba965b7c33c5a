"""The base of all of `launch`: events and their handlers, the context, substitutions, conditions.

Owns: the state of a running launch (`LaunchContext`), and the classes that programs derive their own
substitutions and entities from. Must not know: which actions and substitutions there are, processes.
"""

import asyncio
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeAlias

__all__ = [
    "BaseEventHandler",
    "Condition",
    "Event",
    "EventHandler",
    "Futures",
    "LaunchContext",
    "LaunchDescriptionEntity",
    "SomeActionsType",
    "SomeActionsType_types_tuple",
    "SomeEntitiesType",
    "SomeEntitiesType_types_tuple",
    "SomeSubstitutionsType",
    "SomeSubstitutionsType_types_tuple",
    "Substitution",
    "SubstitutionFailure",
    "TextSubstitution",
    "ensure_argument_type",
    "is_a",
    "is_a_subclass",
    "isclassinstance",
    "normalize_to_list_of_entities",
    "normalize_to_list_of_substitutions",
    "perform_substitutions",
    "visit_all",
    "visit_all_entities_and_collect_futures",
]

_DEEPEST: Final = 150
"""Entities inside entities; more is a launch file that includes itself."""


class SubstitutionFailure(Exception):
    """A substitution has no value; the text says why."""


class Substitution:
    """A text that is known only when it is needed; `perform` returns it."""

    def describe(self) -> str:
        return repr(self)

    def perform(self, context: "LaunchContext") -> str:
        raise NotImplementedError(f"{type(self).__name__} has no perform(context)")


class TextSubstitution(Substitution):
    """A text that is known already."""

    def __init__(self, *, text: str) -> None:
        super().__init__()
        if not isinstance(text, str):
            raise TypeError(f"TextSubstitution expected Text object got '{type(text)}' instead.")
        self.__text = text

    @property
    def text(self) -> str:
        return self.__text

    def describe(self) -> str:
        return f"'{self.text}'"

    def perform(self, context: "LaunchContext") -> str:
        return self.text


SomeSubstitutionsType: TypeAlias = str | Path | Substitution | Iterable[str | Path | Substitution]
SomeSubstitutionsType_types_tuple: Final = (str, Path, Substitution, Iterable)


class Event:
    """Something that happened; handlers look at its class."""

    name = "launch.Event"


class LaunchDescriptionEntity:
    """A part of a launch description: `visit` does its work, and may return more entities."""

    def visit(self, context: "LaunchContext") -> "Sequence[LaunchDescriptionEntity] | None":
        return None

    def describe(self) -> str:
        return repr(self)

    def describe_sub_entities(self) -> "list[LaunchDescriptionEntity]":
        """The entities that it will visit in any case."""
        return []

    def describe_conditional_sub_entities(
        self,
    ) -> "list[tuple[str, Iterable[LaunchDescriptionEntity]]]":
        """The entities that it may visit, and when, in words."""
        return []

    def get_asyncio_future(self) -> "asyncio.Future[Any] | None":
        """Done when the entity's work is done; None if the visit itself completes the work."""
        return None


SomeEntitiesType: TypeAlias = LaunchDescriptionEntity | Iterable[LaunchDescriptionEntity]
SomeActionsType: TypeAlias = SomeEntitiesType
SomeEntitiesType_types_tuple: Final = (LaunchDescriptionEntity, Iterable)
SomeActionsType_types_tuple: Final = SomeEntitiesType_types_tuple


class BaseEventHandler:
    """Called for each event that its matcher takes."""

    def __init__(self, *, matcher: Callable[[Event], bool], handle_once: bool = False) -> None:
        self.__matcher = matcher
        self.__handle_once = handle_once

    @property
    def handle_once(self) -> bool:
        return self.__handle_once

    @property
    def handler_description(self) -> str:
        return "launch.BaseEventHandler"

    @property
    def matcher_description(self) -> str:
        return str(self.__matcher)

    def matches(self, event: Event) -> bool:
        return self.__matcher(event)

    def describe(self) -> tuple[str, list[LaunchDescriptionEntity]]:
        name = type(self).__name__
        text = f"{name}(matcher='{self.matcher_description}', handler='{self.handler_description}', "
        return f"{text}handle_once={self.handle_once})", []

    def handle(self, event: Event, context: "LaunchContext") -> SomeEntitiesType | None:
        """Derived classes call it first; it returns nothing to visit."""
        context.extend_locals({"event": event})
        if self.handle_once:
            context.unregister_event_handler(self)
        return None


class EventHandler(BaseEventHandler):
    """Visits the same entities for each event."""

    def __init__(
        self,
        *,
        matcher: Callable[[Event], bool],
        entities: SomeEntitiesType | None = None,
        handle_once: bool = False,
    ) -> None:
        super().__init__(matcher=matcher, handle_once=handle_once)
        self.__entities = entities

    @property
    def entities(self) -> SomeEntitiesType | None:
        return self.__entities

    @property
    def handler_description(self) -> str:
        return "launch.EventHandler"

    def describe(self) -> tuple[str, list[LaunchDescriptionEntity]]:
        return super().describe()[0], normalize_to_list_of_entities(self.__entities)

    def handle(self, event: Event, context: "LaunchContext") -> SomeEntitiesType | None:
        super().handle(event, context)
        return self.__entities


class _Locals:
    """`context.locals.event`: the values that the current entity can see."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        object.__setattr__(self, "_Locals__values", values)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"context.locals can't be changed: use context.extend_locals for '{name}'")

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__values[name]
        except KeyError:
            raise AttributeError(f"context.locals does not contain attribute '{name}'") from None


class LaunchContext:
    """The state of a running launch: configurations, environment, locals, events that wait."""

    def __init__(self, *, argv: Iterable[str] | None = None, noninteractive: bool = False) -> None:
        self.__argv = [] if argv is None else list(argv)
        self.__noninteractive = noninteractive
        # A caller that puts an event here has handled one, or waits until all are handled, so the queue stays
        # short.
        self._event_queue: asyncio.Queue[Event | None] = asyncio.Queue()
        self._event_handlers: list[BaseEventHandler] = []
        self._completion_futures: set[asyncio.Future[Any]] = set()
        self.__locals: dict[str, Any] = {}
        self.__globals: dict[str, Any] = {}
        self.__locals_stack: list[dict[str, Any]] = []
        self.__configurations: dict[str, Any] = {}
        self.__configurations_stack: list[dict[str, Any]] = []
        self.__environment_at_start = dict(os.environ)
        self.__environment_stack: list[dict[str, str]] = []
        self._at_end: list[Callable[[], object]] = []  # called when all processes have ended
        self.__is_shutdown = False
        self.__asyncio_loop: asyncio.AbstractEventLoop | None = None
        self.__depth = 0

    @property
    def argv(self) -> list[str]:
        return self.__argv

    @property
    def noninteractive(self) -> bool:
        return self.__noninteractive

    @property
    def asyncio_loop(self) -> asyncio.AbstractEventLoop | None:
        return self.__asyncio_loop

    def _set_asyncio_loop(self, loop: asyncio.AbstractEventLoop | None) -> None:
        self.__asyncio_loop = loop
        waiting, self._event_queue = self._event_queue, asyncio.Queue()  # a queue belongs to one loop
        while not waiting.empty():
            self._event_queue.put_nowait(waiting.get_nowait())

    @property
    def is_shutdown(self) -> bool:
        return self.__is_shutdown

    def _set_is_shutdown(self, state: bool) -> None:
        self.__is_shutdown = state

    # --- values that the entities of one file, or of one event, share

    @property
    def locals(self) -> _Locals:
        return _Locals(self.get_locals_as_dict())

    def get_locals_as_dict(self) -> dict[str, Any]:
        return {**self.__globals, **self.__locals}

    def extend_locals(self, extensions: Mapping[str, Any]) -> None:
        self.__locals.update(extensions)

    def _remove_locals(self, names: Iterable[str]) -> None:
        for name in names:
            self.__locals.pop(name, None)

    def extend_globals(self, extensions: Mapping[str, Any]) -> None:
        self.__globals.update(extensions)

    def _push_locals(self) -> None:
        self.__locals_stack.append(dict(self.__locals))

    def _pop_locals(self) -> None:
        self.__locals = _popped(self.__locals_stack, "locals")

    # --- launch configurations

    @property
    def launch_configurations(self) -> dict[str, Any]:
        return self.__configurations

    def _push_launch_configurations(self) -> None:
        self.__configurations_stack.append(dict(self.__configurations))

    def _pop_launch_configurations(self) -> None:
        self.__configurations = _popped(self.__configurations_stack, "launch_configurations")

    # --- environment of this process, which children inherit

    @property
    def environment(self) -> "os._Environ[str]":
        return os.environ

    def _push_environment(self) -> None:
        self.__environment_stack.append(dict(os.environ))

    def _pop_environment(self) -> None:
        self.__set_environment(_popped(self.__environment_stack, "environment"))

    def _reset_environment(self) -> None:
        self.__set_environment(self.__environment_at_start)

    @staticmethod
    def __set_environment(values: Mapping[str, str]) -> None:
        for name in set(os.environ) - set(values):
            del os.environ[name]
        os.environ.update(values)

    # --- events

    def register_event_handler(self, event_handler: BaseEventHandler, append: bool = False) -> None:
        """The newest is asked first, or with `append` last."""
        self._event_handlers.insert(len(self._event_handlers) if append else 0, event_handler)

    def unregister_event_handler(self, event_handler: BaseEventHandler) -> None:
        """Raises ValueError for a handler that is not registered."""
        self._event_handlers.remove(event_handler)

    def would_handle_event(self, event: Event) -> bool:
        return any(handler.matches(event) for handler in self._event_handlers)

    def emit_event_sync(self, event: Event) -> None:
        self._event_queue.put_nowait(event)

    async def emit_event(self, event: Event) -> None:
        self._event_queue.put_nowait(event)

    def add_completion_future(self, completion_future: "asyncio.Future[Any]") -> None:
        """The launch goes on until it is done, too."""
        self._completion_futures.add(completion_future)
        completion_future.add_done_callback(self.__completed)

    def __completed(self, future: "asyncio.Future[Any]") -> None:
        self._completion_futures.discard(future)
        self._event_queue.put_nowait(None)

    # --- substitutions

    def perform_substitution(self, sub: Substitution) -> str:
        try:
            return sub.perform(self)
        except RecursionError:
            pass  # its frames would be in the traceback
        raise SubstitutionFailure(f"substitutions go round in a circle, at a {type(sub).__name__}")

    def _enter(self) -> None:
        self.__depth += 1
        if self.__depth > _DEEPEST:
            file = self.get_locals_as_dict().get("current_launch_file_path")
            where = f": does '{file}' include itself?" if file else ""
            raise RuntimeError(f"more than {_DEEPEST} entities inside each other{where}")

    def _leave(self) -> None:
        self.__depth -= 1


def _popped(stack: list[Any], what: str) -> Any:
    if not stack:
        raise RuntimeError(f"{what} stack unexpectedly empty")
    return stack.pop()


class Condition:
    """Decides, when an action is visited, whether it is executed."""

    def __init__(self, *, predicate: "Callable[[LaunchContext], bool] | None" = None) -> None:
        self._predicate = predicate

    def describe(self) -> str:
        return repr(self)

    def evaluate(self, context: LaunchContext) -> bool:
        if self._predicate is None:
            raise NotImplementedError(f"{type(self).__name__} has no predicate")
        return self._predicate(context)


# --- the public functions of `launch.utilities`


def isclassinstance(obj: object) -> bool:
    """True: in Python, every object is an instance of a class."""
    return hasattr(obj, "__class__")


def is_a(obj: object, entity_type: type) -> bool:
    """Raises RuntimeError if `entity_type` is no class."""
    if not isinstance(entity_type, type):
        raise RuntimeError(f"entity_type '{entity_type}' is not a class")
    return isinstance(obj, entity_type)


def is_a_subclass(obj: object, entity_type: type) -> bool:
    return isinstance(obj, entity_type) or (isinstance(obj, type) and issubclass(obj, entity_type))


def ensure_argument_type(
    argument: object,
    types: type | Iterable[type],
    argument_name: str,
    caller: str | None = None,
) -> None:
    """Raise TypeError if the argument has another type."""
    expected = (types,) if isinstance(types, type) else tuple(types)
    if isinstance(argument, expected):
        return
    names = ", ".join(f"'{one.__name__}'" for one in expected)
    place = f" to {caller}" if caller else ""
    raise TypeError(
        f"Expected '{argument_name}'{place} to be one of [{names}], but got '{argument!r}' of type "
        f"'{type(argument).__name__}'"
    )


def normalize_to_list_of_substitutions(subs: SomeSubstitutionsType) -> list[Substitution]:
    """A text, a substitution, or several of them in turn, as a list; raises TypeError for other things."""
    if isinstance(subs, str | Path | Substitution):
        return [_substitution(subs)]
    if isinstance(subs, Iterable):
        return [_substitution(one) for one in subs]
    raise TypeError(
        f"Failed to normalize given item of type '{type(subs)}', when only 'str' or "
        "'launch.Substitution' were expected."
    )


def _substitution(one: object) -> Substitution:
    if isinstance(one, Substitution):
        return one
    if isinstance(one, str | Path):
        return TextSubstitution(text=str(one))
    raise TypeError(
        f"Failed to normalize given item of type '{type(one)}', when only 'str' or 'launch.Substitution' "
        "were expected."
    )


def perform_substitutions(context: LaunchContext, subs: Iterable[Substitution]) -> str:
    """The texts of all, one after the other."""
    return "".join([context.perform_substitution(one) for one in subs])


def normalize_to_list_of_entities(entities: SomeEntitiesType | None) -> list[LaunchDescriptionEntity]:
    if entities is None:
        return []
    if isinstance(entities, LaunchDescriptionEntity):
        return [entities]
    return [one for entity in entities for one in normalize_to_list_of_entities(entity)]


Futures: TypeAlias = "list[tuple[LaunchDescriptionEntity, asyncio.Future[Any]]]"


def visit_all_entities_and_collect_futures(
    entity: LaunchDescriptionEntity, context: LaunchContext
) -> Futures:
    """Visit an entity, then the entities that it returns, and so on; returns futures of unfinished work."""
    found: Futures = []
    visit_all(entity, context, found)
    return found


def visit_all(entity: LaunchDescriptionEntity, context: LaunchContext, found: Futures) -> None:
    """As above; if one raises, `found` has the futures of the entities visited before it."""
    context._enter()
    try:
        below = entity.visit(context)
        future = entity.get_asyncio_future()
        if future is not None:
            found.append((entity, future))
        for one in below or ():
            visit_all(one, context, found)
    finally:
        context._leave()
