"""The five endpoints of an action at each of its ends, on ROS 2's names: three services and two topics.

Owns: their names and policies, and the order in which they appear: a program that sees the last one finds all
of them. Knows no goals: its maker passes a callback for each message.
"""

from collections.abc import Callable
from typing import Any, Final

import msgspec

from bus.endpoint.endpoint import core_of
from bus.errors import BusError
from bus.node import SERVICE_QOS, Node
from bus.publisher import Publisher
from bus.qos import QoSProfile, action_status_default
from bus.service.client import ServiceClient
from bus.service.server import RequestId, ServiceServer
from bus.subscription import Subscription
from bus_actions.action_type import ActionSupport

__all__ = ["ActionQoS", "ClientEndpoints", "ServerEndpoints"]

_HIDDEN: Final = "/_action/"
FEEDBACK: Final = f"{_HIDDEN}feedback"


class ActionQoS(msgspec.Struct, frozen=True, kw_only=True):
    """The policies of an action's endpoints.

    For example:

        ActionQoS(feedback=QoSProfile(depth=1))
    """

    goal_service: QoSProfile = SERVICE_QOS
    """Goals, and whether they are accepted."""
    result_service: QoSProfile = SERVICE_QOS
    """Results."""
    cancel_service: QoSProfile = SERVICE_QOS
    """Requests to cancel."""
    feedback: QoSProfile = QoSProfile(depth=100)
    """Feedback of all goals."""
    status: QoSProfile = action_status_default
    """The states of all goals."""


class ServerEndpoints:
    """The endpoints of a server; `open` makes them."""

    goal: ServiceServer
    cancel: ServiceServer
    result: ServiceServer
    feedback: Publisher[Any]
    status: Publisher[Any]

    async def open(
        self,
        node: Node,
        support: ActionSupport,
        name: str,
        qos: ActionQoS,
        *,
        on_goal: Callable[[Any, RequestId], Any],
        on_cancel: Callable[[Any, RequestId], Any],
        on_result: Callable[[Any, RequestId], Any],
        on_end: Callable[[BusError], object] | None = None,
    ) -> None:
        """Raises the errors of `Node.create_service`. After a cancellation it is not open.

        `on_end` is called once no goal can come any more, whatever the cause.
        """
        begin = name + _HIDDEN
        try:
            self.feedback = await node.create_publisher(
                support.feedback_message, f"{begin}feedback", qos.feedback
            )
            self.status = await node.create_publisher(support.status_array, f"{begin}status", qos.status)
            self.result = await node.create_service(
                support.get_result, f"{begin}get_result", qos=qos.result_service, on_request=on_result
            )
            self.cancel = await node.create_service(
                support.cancel_goal, f"{begin}cancel_goal", qos=qos.cancel_service, on_request=on_cancel
            )
            self.goal = await node.create_service(
                support.send_goal, f"{begin}send_goal", qos=qos.goal_service, on_request=on_goal
            )
            core_of(core_of(self.goal).requests).on_end = on_end
        except BaseException:
            await self.close()
            raise

    @property
    def action_name(self) -> str:
        """The full name."""
        return self.goal.service_name.removesuffix(f"{_HIDDEN}send_goal")

    def answer_result(self, request_id: RequestId, response: Any, error: str = "") -> None:
        """As `ServerCore.answer` of the service `result`, after the feedback that was published before."""
        core_of(self.feedback).hand_over()  # by the socket it would wait for the end of this turn
        core_of(self.result).answer(request_id, response, error)

    async def close(self) -> None:
        await _close(self, ("goal", "cancel", "result", "feedback", "status"))


class ClientEndpoints:
    """The endpoints of a client; `open` makes them."""

    goal: ServiceClient
    cancel: ServiceClient
    result: ServiceClient
    feedback: Subscription[Any]
    status: Subscription[Any]

    async def open(  # noqa: PLR0913
        self,
        node: Node,
        support: ActionSupport,
        name: str,
        qos: ActionQoS,
        *,
        on_goal: Callable[[int, Any], object],
        on_cancel: Callable[[int, Any], object],
        on_result: Callable[[int, Any], object],
        on_feedback: Callable[[Any], object] | None,
        on_status: Callable[[Any], object] | None,
    ) -> None:
        """Raises the errors of `Node.create_client`. After a cancellation it is not open."""
        begin = name + _HIDDEN
        try:
            self.feedback = await node.create_subscription(
                support.feedback_message, f"{begin}feedback", qos.feedback, on_feedback
            )
            self.status = await node.create_subscription(
                support.status_array, f"{begin}status", qos.status, on_status
            )
            self.result = await node.create_client(
                support.get_result, f"{begin}get_result", qos.result_service, on_response=on_result
            )
            self.cancel = await node.create_client(
                support.cancel_goal, f"{begin}cancel_goal", qos.cancel_service, on_response=on_cancel
            )
            self.goal = await node.create_client(
                support.send_goal, f"{begin}send_goal", qos.goal_service, on_response=on_goal
            )
        except BaseException:
            await self.close()
            raise

    @property
    def action_name(self) -> str:
        """The full name."""
        return self.goal.service_name.removesuffix(f"{_HIDDEN}send_goal")

    def is_ready(self) -> bool:
        """Whether a server exists, with all its endpoints."""
        return (
            self.goal.service_is_ready()
            and self.cancel.service_is_ready()
            and self.result.service_is_ready()
            and self.feedback.get_publisher_count() > 0
            and self.status.get_publisher_count() > 0
        )

    async def wait_until_ready(self) -> None:
        """Raises ConnectionClosed if it is closed meanwhile. Cancellation leaves nothing behind."""
        while not self.is_ready():
            for service in (self.goal, self.cancel, self.result):
                await service.wait_for_service()
            for topic in (self.feedback, self.status):
                await topic.wait_for_publishers()

    async def close(self) -> None:
        await _close(self, ("goal", "cancel", "result", "feedback", "status"))


async def _close(ends: ServerEndpoints | ClientEndpoints, names: tuple[str, ...]) -> None:
    """Close the existing endpoints, one after another; raises the first error."""
    made = [getattr(ends, name) for name in names if hasattr(ends, name)]
    failure: BusError | None = None
    for one in made:
        try:
            await one.close()
        except BusError as error:
            failure = failure or error
    if failure is not None:
        raise failure
