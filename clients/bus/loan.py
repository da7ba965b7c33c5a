"""A place for a long field of a message, which the program fills in shared memory."""

from collections.abc import Callable
from types import TracebackType

from bus.errors import LocalProtocolError


class Loan:
    """A buffer for one message, made by `Publisher.loan`. Fill `buffer`, then `publish` or `discard`.

    As a context manager it returns the buffer, publishes at the end and discards after an exception.

        if loan := images.loan(Image(height=480, width=640), "data", 640 * 480):
            with loan as buffer:
                camera.readinto(buffer)
    """

    __slots__ = ("__weakref__", "_finish", "buffer")

    def __init__(self, buffer: memoryview, finish: "Callable[[Loan, bool], bool]") -> None:
        self.buffer = buffer
        """Writable bytes; don't use it after the loan has ended."""
        self._finish: Callable[[Loan, bool], bool] | None = (
            finish  # `finish` itself sets None when the loan has ended
        )

    def publish(self) -> bool:
        """Publish the message with the buffer's contents; returns and raises as `Publisher.publish`.

        Raises LocalProtocolError if the loan has ended already, or on another thread.
        """
        return self._end(True)

    def discard(self) -> None:
        """Publish nothing. Has no effect if the loan has ended."""
        if self._finish is not None:
            self._end(False)

    def __enter__(self) -> memoryview:
        return self.buffer

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.publish()
        else:
            self.discard()

    def __del__(self) -> None:
        if getattr(self, "_finish", None) is not None:  # not set if a signal interrupted the constructor
            self._end(False)

    def _end(self, is_wanted: bool) -> bool:
        finish = self._finish
        if finish is None:
            raise LocalProtocolError("the loan has ended already")
        try:
            self.buffer.release()
        except BufferError:  # an array made of the buffer still exists
            pass
        return finish(self, is_wanted)
