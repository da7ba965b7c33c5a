"""The short way of a message: from the native reader directly to an executor that only waits for it.

An executor takes messages from the queue of a subscription, in the order in which subscriptions are ready.
While its thread waits with nothing else to do, the reader hands each message over as it comes (`receive`). If
only one subscription has had messages lately, the thread waits for that one alone (`sleep`), without the
event loop. All under the engine's guard.
"""

from typing import Any, Protocol

from bus.delivery.receiver import Receiver
from bus.endpoint.endpoint import core_of
from bus.subscription import Subscription as NativeSubscription
from bus_ros.engine import Engine, Waiter
from bus_ros.entity import Line, Owner

__all__ = ["Handover"]


class Receiving(Protocol):
    """The interface of a subscription for its handover."""

    batch: int
    is_queued: bool
    is_destroyed: bool

    @property
    def native(self) -> NativeSubscription[Any]: ...
    @property
    def node(self) -> Owner: ...
    def notify(self) -> None: ...


class Handover:
    """The handover of one subscription's messages to the executor of its node."""

    def __init__(self, engine: Engine, subscription: Receiving) -> None:
        self._engine = engine
        self.subscription = subscription
        self._receiver: Receiver[Any] = core_of(subscription.native).receiver
        self.executor: Line | None = None
        """The executor that may be handed a message as it comes. None: messages wait until it takes them."""
        self._wait: Any = None  # the reader's
        self.is_waited_for = False
        """A thread is in `sleep` and takes the next message. To keep the order, no other code may take one.
        """
        self._is_quiet = False  # losses have no callback, which would need a look at each message

    def begin(self, executor: Line | None) -> None:
        """Hand messages to `executor` from now on, the present one of the node."""
        subscription = self.subscription
        self.end()
        if executor is not None and self._receiver.reader is not None and not subscription.is_destroyed:
            self.executor = executor
            executor.handed.add(self)
            self._receiver.call_back(self.receive, _raise, executor.ready, executor.waiter.shut)
            self._wait = self._receiver.quick_wait(with_info=False)
            self._is_quiet = core_of(subscription.native).events.message_lost is None

    def end(self) -> None:
        """Hand nothing over any more: messages wait until an executor takes them."""
        if (executor := self.executor) is not None:
            executor.handed.discard(self)
            if executor.last_handed is self:
                executor.last_handed = executor.lone = None
                executor.waiter.set()  # it may be in `sleep`
        self.executor = None
        if self._receiver.reader is not None:
            self._receiver.reader.forget_callback()

    def receive(self, message: Any) -> None:
        """Queue a message from the native reader; called while the executor's thread only runs the loop."""
        subscription = self.subscription
        subscription.batch = 2
        self._receiver.ahead.append((message, 0, 0, None, 0))
        executor = self.executor
        if executor is not None and not subscription.is_queued:
            subscription.is_queued = executor.waiter.is_set = True
            executor.ready.append(subscription)
            executor.lone = self if executor.last_handed is self and self._is_quiet else None
            executor.last_handed = self

    def sleep(self, waiter: Waiter, deadline_ns: int) -> bool:
        """Wait only for the next message, in fewer steps than the loop does; returns whether it is queued.

        False if something else has happened, or has to be done first.
        """
        if self.is_waited_for or (executor := self.executor) is None:
            return False
        self.is_waited_for = True
        try:
            message = self._engine.sleep(waiter, self._wait, deadline_ns)
        finally:
            self.is_waited_for = False
        if executor is self.executor and not self._receiver.has_rejected:
            if message is not None:
                self.receive(message)
            return message is not None
        if message is not None:
            self._receiver.put_back([message])
        self.subscription.notify()  # another executor passed over it, or `take` has something to report
        return False


def _raise(error: Exception) -> None:
    raise error
