"""Several filters in a row, as one filter."""

from typing import Any

from bus_ros.message_filters.simple_filter import SimpleFilter

__all__ = ["Chain"]


class Chain(SimpleFilter):
    """Passes its input through its filters, in order; without filters, passes it on unchanged.

    A filter in a chain has a method `add`, as Cache has.
    """

    def __init__(self, message_filter: SimpleFilter | None = None) -> None:
        super().__init__()
        self.incoming_connection: int | None = None
        self._filters: list[Any] = []
        self._output = -1
        if message_filter is not None:
            self.connectInput(message_filter)

    def connectInput(self, message_filter: SimpleFilter) -> None:
        """Take the filter's output as input. Raises RuntimeError if there is an input already."""
        if self.incoming_connection is not None:
            raise RuntimeError("Already connected")
        self.incoming_connection = message_filter.registerCallback(self.add)

    def add(self, message: Any) -> None:
        if self._filters:
            self._filters[0].add(message)
        else:
            self.signalMessage(message)

    def addFilter(self, message_filter: Any) -> None:
        """Append a filter."""
        if self._filters:
            last = self._filters[-1]
            del last.callbacks[self._output]
            last.registerCallback(message_filter.add)
        self._output = message_filter.registerCallback(self.signalMessage)
        self._filters.append(message_filter)

    def getFilter(self, index: int) -> Any:
        """The filter at that index; raises KeyError if there is none."""
        if not 0 <= index < len(self._filters):
            raise KeyError(index)
        return self._filters[index]
