"""Calls a subscription's callback for the samples in its receiver, with turns for other work in between.

Calls of one subscription never overlap. The native reader itself calls a plain callback for one message from
a ring (`Readers.deliver`). Both share one flag, set while a call is in progress.
"""

from collections.abc import Awaitable, Callable
from time import monotonic_ns
from typing import Any, Generic, TypeVar

from bus.base.callbacks import call_async, is_async, refuse_coroutine, takes_info
from bus.delivery.port import Port
from bus.delivery.receiver import Receiver, Taken
from bus.diagnostics.slow_callback import SLOW_NS
from bus.errors import ConnectionClosed
from bus.wire.runs import Run

M = TypeVar("M")

_TURN_NS = 5_000_000
_MOST_IN_A_TURN = 64


class _Calls:
    """Stands for the native reader, if there is none."""

    __slots__ = ("is_busy",)

    def __init__(self) -> None:
        self.is_busy = False


class Dispatcher(Generic[M]):
    """Calls the callback of one subscription.

    `make_info` makes the second argument of a callback with two; `receive` waits for the next message.
    `on_error` gets errors of the callback, `on_slow` the nanoseconds of a slow plain callback. `is_timed`: a
    deadline must see each message.
    """

    def __init__(  # noqa: PLR0913
        self,
        port: Port,
        callback: Callable[..., Any],
        receiver: Receiver[M],
        *,
        make_info: Callable[[Taken[M]], Any],
        receive: Callable[[], Awaitable[tuple[M, Any]]],
        on_error: Callable[[BaseException], None],
        name: str,
        is_timed: bool,
        on_slow: Callable[[int], object] | None = None,
    ) -> None:
        self._callback = callback
        self._receiver = receiver
        self._make_info = make_info
        self._receive = receive
        self._on_error = on_error
        self._on_slow = on_slow or _ignore
        self._slow_option = on_slow
        self._wants_info = takes_info(callback)
        self._is_timed = is_timed
        self._port = port
        self._has_ended = False
        self._calls = _Calls() if receiver.reader is None else receiver.reader
        """Its `is_busy` is set while a call is in progress, or the next turn is scheduled."""
        self._cancel: Callable[[], object] | None = None
        if is_async(callback):
            self._cancel = port.start(self._run(), f"callback of {name}")
        self.is_plain = self._cancel is None and not self._wants_info and not is_timed
        """Whether the callback is a plain function of the message alone, and there is no deadline."""
        if self.is_plain and receiver.reader is not None:
            receiver.call_back(callback, on_error, on_slow=on_slow)

    @property
    def is_async(self) -> bool:
        """Whether the callback is a coroutine function; then a task takes messages by `receive`."""
        return self._cancel is not None

    def replace_callback(self, callback: Callable[..., Any]) -> None:
        """Call `callback` from the next turn on. Both are coroutine functions, or none is."""
        self._callback = callback
        self._wants_info = takes_info(callback)
        self.is_plain = self._cancel is None and not self._wants_info and not self._is_timed
        if self._receiver.reader is not None:
            if self.is_plain:
                self._receiver.call_back(callback, self._on_error, on_slow=self._slow_option)
            else:
                self._receiver.reader.forget_callback()

    def end(self) -> None:
        """Stop calling back."""
        self._has_ended = True
        if self._receiver.reader is not None:
            self._receiver.reader.forget_callback()
        if self._cancel is not None:
            self._cancel()

    def deliver(self, run: Run) -> bool:
        """Call back for a run that has just come, and return True; False: nothing was done, put the run.

        Only for a callback that `is_plain`.
        """
        state = self._calls
        if state.is_busy or self._has_ended or (taken := self._receiver.take_lone(run)) is None:
            return False
        state.is_busy = True
        began_ns = monotonic_ns()
        try:
            if (answer := self._callback(taken[0])) is not None:
                refuse_coroutine(self._callback, answer)
        except Exception as error:
            self._on_error(error)
        finally:
            state.is_busy = False
            if (took_ns := monotonic_ns() - began_ns) >= SLOW_NS:
                self._on_slow(took_ns)
        if self._receiver.has_more:
            self.dispatch()
        return True

    def dispatch(self) -> None:
        """Call back for waiting samples."""
        state = self._calls
        if state.is_busy:
            return
        state.is_busy = True
        is_scheduled = False
        callback, receiver, wants_info = self._callback, self._receiver, self._wants_info
        calls, number, end_ns = 0, 1, 0
        began_ns = monotonic_ns()
        try:
            while not self._has_ended:
                if not wants_info and (messages := receiver.take_messages(number)):
                    calls += len(messages)
                    if len(messages) == 1:
                        if (answer := callback(messages[0])) is not None:
                            refuse_coroutine(callback, answer)
                    else:
                        self._call_with(messages)
                elif (taken := receiver.take(number)) is None:
                    return
                else:
                    calls += 1
                    info = (self._make_info(taken),) if wants_info else ()
                    if (answer := callback(taken[0], *info)) is not None:
                        refuse_coroutine(callback, answer)
                if calls < number:
                    continue
                if not receiver.has_more:
                    return
                now_ns = monotonic_ns()
                if end_ns == 0:
                    calls, end_ns = 0, now_ns + _TURN_NS  # a turn begins after its first call
                    continue
                if now_ns > end_ns:
                    # Give timers and sockets a turn: a slow callback must not get stale messages.
                    # Until then there is no other dispatch: the turns would add up.
                    is_scheduled = True
                    self._port.soon(self._dispatch_on)
                    return
                # A fast callback gets more messages at a time, which saves readings of the clock.
                calls, number = 0, min(2 * number, _MOST_IN_A_TURN)
        except Exception as error:
            self._on_error(error)
        except BaseException:  # the event loop may continue after it; then the remaining samples need a turn
            is_scheduled = True
            self._port.soon(self._dispatch_on)
            raise
        finally:
            state.is_busy = is_scheduled
            if (took_ns := monotonic_ns() - began_ns) >= SLOW_NS:
                self._on_slow(took_ns)

    def _call_with(self, messages: list[M]) -> None:
        """Call back for each message; after an exception, the remaining messages wait to be taken again."""
        callback, left = self._callback, iter(messages)
        try:
            for message in left:
                if (answer := callback(message)) is not None:
                    refuse_coroutine(callback, answer)
                if self._has_ended:
                    break
        finally:
            self._receiver.put_back(list(left))

    def _dispatch_on(self) -> None:
        self._calls.is_busy = False
        self.dispatch()

    async def _run(self) -> None:
        while True:
            try:
                message, info = await self._receive()
            except ConnectionClosed:
                return
            callback = self._callback  # it may have been replaced
            try:
                await (
                    call_async(callback, message, info) if self._wants_info else call_async(callback, message)
                )
            except Exception as error:
                self._on_error(error)


def _ignore(took_ns: int) -> None:
    """Stands for `on_slow`, for callbacks that are not reported."""
