"""Clients of the facade: a native client, and futures that its answers complete."""

from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from bus.endpoint.endpoint import core_of
from bus.errors import BusError, ServiceUnavailable
from bus_ros.engine import Engine, Waiter, deadline_after
from bus_ros.entity import Entity, Group, Owner, Work
from bus_ros.rclpy.destroyable import Destroyable
from bus_ros.rclpy.exceptions import InvalidHandle
from bus_ros.rclpy.impl.introspected import Introspected
from bus_ros.rclpy.qos import QoSProfile
from bus_ros.rclpy.task import Answer, Future

if TYPE_CHECKING:  # most programs have no clients
    from bus.service.client import ServiceClient

__all__ = ["BaseClient", "Client"]


class BaseClient(Introspected, Destroyable):
    """Base of `Client` and of `rclpy.experimental.AsyncClient`."""

    def __init__(self, srv_type: Any, srv_name: str, qos_profile: QoSProfile) -> None:
        self.srv_type = srv_type
        self.srv_name = srv_name
        self.qos_profile = qos_profile


class Client(Entity, BaseClient):
    """Made by `Node.create_client`."""

    rank = 4
    native: "ServiceClient"
    """Set by the node right after it is made."""

    def __init__(
        self,
        engine: Engine,
        srv_type: Any,
        srv_name: str,
        qos_profile: QoSProfile,
        callback_group: Group,
        node: Owner,
    ) -> None:
        BaseClient.__init__(self, srv_type, srv_name, qos_profile)
        self._engine = engine
        self._futures: dict[int, Future[Any]] = {}
        self._answers: deque[tuple[Future[Any], object, int]] = deque()
        self._callers: list[Waiter] = []  # threads in `call`
        Entity.__init__(self, node, callback_group)
        self.held_group = None  # an answer calls no callback, and a callback of the group may await it

    @property
    def service_name(self) -> str:
        return self.native.service_name

    def call(self, request: object, timeout_sec: float | None = None) -> Any:
        """Call the service and wait for the answer; None if `timeout_sec` is over first.

        Works with or without a spinning thread. Raises TypeError if `request` is not a request of the
        service, and the error of the service.
        """
        future = self.call_async(request)
        engine = self._engine
        with engine.loop:
            waiter = Waiter(engine, self.node.context)
            self._callers.append(waiter)
        future.call_when_done(lambda: engine.call(waiter.set))
        deadline_ns = deadline_after(timeout_sec)
        try:
            while not future.done():
                with engine.loop:
                    waiter.is_set = not self.node.context.ok()  # the end may have come before `wake_at_end`
                    is_over = not self._answers and not waiter.wait(deadline_ns)
                    work = self.take(1)
                if work is not None:
                    work[0](*work[1])
                elif is_over or not self.node.context.ok():
                    break
        finally:
            with engine.loop:
                self._callers.remove(waiter)
        if not future.done():
            self.remove_pending_request(future)
            return None
        return future.result()

    def call_async(self, request: object) -> Future[Any]:
        """Call the service; returns a future for the answer, which stays open without one.

        Raises TypeError if `request` is not a request of the service, InvalidHandle after the client, or its
        node, was destroyed.
        """
        if not isinstance(request, self.srv_type.Request):
            raise TypeError(f"expected a {self.srv_type.Request.__name__}, got {type(request).__name__}")
        if self.is_destroyed:
            raise InvalidHandle(f"the client of service '{self.service_name}' is destroyed")
        with self._engine.loop:
            future: Answer[Any] = Answer(executor=self.node.own_executor)
            future.drop = self.remove_pending_request
            number = self.native.send_request(request)
            if number:
                self._futures[number] = future
        if number and self.events is not None:
            self.events.publish_event("REQUEST_SENT", core_of(self.native).gid, number, request=request)
        if not number:
            raise RuntimeError(f"no room to call service '{self.service_name}'")
        return future

    def get_pending_request(self, sequence_number: int) -> Future[Any]:
        """The future of a pending call; raises KeyError if there is none."""
        return self._futures[sequence_number]

    def remove_pending_request(self, future: Future[Any]) -> None:
        """Stop waiting for this answer."""
        with self._engine.loop:
            for number, one in tuple(self._futures.items()):
                if one is future:
                    del self._futures[number]
                    self.native.forget(number)

    def service_is_ready(self) -> bool:
        """Whether a server of the service exists."""
        with self._engine.loop:
            return self.native.service_is_ready()

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        """Wait for a server, at most `timeout_sec` (None, negative: for ever); returns whether one exists."""
        with suppress(TimeoutError):
            self._engine.run(self.native.wait_for_service, timeout_sec, context=self.node.context)
        return self.service_is_ready()

    def destroy(self) -> None:
        """Stop waiting for answers."""
        self.node.destroy_client(self)

    # --- for the native client and the executor, under the guard

    def on_response(self, number: int, outcome: object) -> None:
        future = self._futures.pop(number, None)
        if future is None or isinstance(outcome, ServiceUnavailable):
            return  # as in ROS, a call stays open if its service has gone
        self._answers.append((future, outcome, number))
        self.notify()
        for waiter in self._callers:
            waiter.set()

    def take(self, most: int) -> Work | None:
        while self._answers:
            future, outcome, number = self._answers.popleft()
            if not future.done():
                break
        else:
            return None
        # There may have been no executor at the call, and a callback's exception must come out of `spin`.
        future._set_executor(self.node.own_executor)
        if isinstance(outcome, BusError):
            return future.set_exception, (outcome,)
        if self.events is not None:
            return self._report_and_set, (future, outcome, number)
        return future.set_result, (outcome,)

    def _report_and_set(self, future: Future[Any], response: object, number: int) -> None:
        if self.events is not None:
            self.events.publish_event(
                "RESPONSE_RECEIVED", core_of(self.native).gid, number, response=response
            )
        future.set_result(response)
