"""The exceptions for a buffer server's answers, with a server of the test."""

from types import SimpleNamespace
from typing import Any

import pytest

from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.task import Future
from bus_ros.rclpy.time import Time
from bus_tf2.messages import message
from bus_tf2.tf2_ros import BufferClient, ConnectivityException, TimeoutException, TransformException
from rows import for_each


def done(result: Any) -> Future[Any]:
    future: Future[Any] = Future()
    future.set_result(result)
    return future


class Client(BufferClient):
    """A client whose server answers each question with one error."""

    def __init__(self, number: int, *, accepted: bool = True) -> None:
        result = message("tf2_msgs/action/LookupTransform_Result")
        result.error.error, result.error.error_string = number, "why"
        answer = SimpleNamespace(
            accepted=accepted, get_result_async=lambda: done(SimpleNamespace(result=result))
        )
        self.timeout_padding = Duration(seconds=10)
        self.action_client: Any = SimpleNamespace(send_goal_async=lambda goal: done(answer))


@for_each(
    ("number", "kind"),
    [
        (2, ConnectivityException),
        (5, TimeoutException),
        (6, TransformException),
        (99, TransformException),
    ],
)
def test_an_error_is_an_exception(number: int, kind: type[Exception]) -> None:
    with pytest.raises(TransformException, match="why") as caught:
        Client(number).lookup_transform("a", "b", Time())
    assert type(caught.value) is kind
    assert not Client(number).can_transform("a", "b", Time())


def test_an_answer_without_an_error() -> None:
    assert Client(0).can_transform("a", "b", Time())
    with pytest.raises(TransformException, match="was not accepted"):
        Client(0, accepted=False).lookup_transform("a", "b", Time())
