"""Filters that pass a message only if it differs from the last passed one."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol

from bus_ros.message_filters.simple_filter import SimpleFilter

__all__ = [
    "CachedComparisonHandler",
    "ComparisonFilter",
    "ComparisonHandler",
    "DeltaCompare",
    "DeltaFilter",
    "PathDeltaFilter",
]

Getter = Callable[[Any], Any]
"""Takes a field out of a message."""


class _Decider(Protocol):
    def message_fits(self, message: Any) -> bool: ...


class ComparisonHandler:
    """Base of handlers that decide which messages pass."""

    def message_fits(self, message: Any) -> bool:
        raise NotImplementedError

    def do_fields_fit(self, field_a: Any, field_b: Any) -> bool:
        raise NotImplementedError


class CachedComparisonHandler(ComparisonHandler):
    """Passes the first message, then messages with a fitting field, compared with the last passed one.

    `_field_getters` selects the compared fields; a subclass defines in `do_fields_fit` whether two fit.
    """

    _field_getters: Iterable[Getter] = ()

    def __init__(self) -> None:
        self._last: Any = None

    def message_fits(self, message: Any) -> bool:
        last = self._last
        fits = last is None or any(self.do_fields_fit(get(last), get(message)) for get in self._field_getters)
        if fits:
            self._last = message
        return fits

    def do_fields_fit(self, field_a: Any, field_b: Any) -> bool:
        raise NotImplementedError(
            f"Field comparison not implemented for class: {type(self).__name__}. "
            "Consider implementing do_fields_fit"
        )


class DeltaCompare(CachedComparisonHandler):
    """Fields fit if they differ. Raises TypeError for a field that is not a number, a boolean or a text."""

    def __init__(self, field_getters: Iterable[Getter]) -> None:
        super().__init__()
        self._field_getters = list(field_getters)

    def do_fields_fit(self, field_a: Any, field_b: Any) -> bool:
        if not (
            isinstance(field_a, bool | int | float | str) and isinstance(field_b, bool | int | float | str)
        ):
            raise TypeError(f"Unable to compare fields of types {type(field_a)} and {type(field_b)}")
        return bool(field_a != field_b)


class ComparisonFilter(SimpleFilter):
    """Puts out the messages that `comparison_handler` lets pass."""

    def __init__(self, comparison_handler: _Decider, message_filter: SimpleFilter | None = None) -> None:
        super().__init__()
        self.incoming_connection: int | None = None
        self._comparison_handler = comparison_handler
        self.connectInput(message_filter)

    def connectInput(self, message_filter: SimpleFilter | None) -> None:
        """Take the filter's output as input. Raises RuntimeError if there is an input already."""
        if self.incoming_connection is not None:
            raise RuntimeError(f"This instance of {type(self).__name__} already has an incoming connection")
        if message_filter is not None:
            self.incoming_connection = message_filter.registerCallback(self.add)

    def message_fits(self, message: Any) -> bool:
        return self._comparison_handler.message_fits(message)

    def add(self, message: Any) -> None:
        if self.message_fits(message):
            self.signalMessage(message)


class DeltaFilter(ComparisonFilter):
    """Puts out a message if one of its fields, as `field_getters` find them, has changed."""

    def __init__(self, field_getters: Sequence[Getter], message_filter: SimpleFilter | None = None) -> None:
        super().__init__(DeltaCompare(field_getters), message_filter)


class PathDeltaFilter(DeltaFilter):
    """Puts out a message if one of these fields has changed: `pose.position.x`, for example.

    Raises RuntimeError for a message that lacks one of the fields.
    """

    def __init__(self, field_path_list: Iterable[str], message_filter: SimpleFilter | None = None) -> None:
        super().__init__([self._getter(path) for path in field_path_list], message_filter)

    def get_field_by_path(self, message: Any, field_path: str) -> Any:
        found = message
        for name in field_path.split("."):
            inner = getattr(found, name, None)
            if inner is None:
                kind = type(found).__name__
                raise RuntimeError(f"Unable to access field {name!r} of {kind} (full path: {field_path!r})")
            found = inner
        return found

    def _getter(self, path: str) -> Getter:
        return lambda message: self.get_field_by_path(message, path)
