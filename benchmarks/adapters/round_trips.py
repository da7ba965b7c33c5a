"""Duration of an action by rclpy, from its goal to its result, of as many native messages, and of a call.

    python -m benchmarks.adapters.round_trips action|messages|call server|client N

An action is a goal of Fibonacci, FEEDBACKS feedbacks and the result. Messages go back and forth, so each
wakes the process that sends the next. A call is one of GetParameterTypes by rclpy. After some unmeasured
ones, the client makes N of them, and says `taken` with their times in ns.
"""

import sys
from collections.abc import Callable
from time import monotonic_ns
from typing import Any

FEEDBACKS = 10
MESSAGES = FEEDBACKS + 2
"""The goal, the feedbacks, the result."""
_WARM_UP = 20
_GOAL, _FEEDBACK, _ASK = "goal", "feedback", "ask"
_ASKED = "rcl_interfaces.srv.GetParameterTypes"
"""A service that every installation of rclpy has."""


class _Rounds:
    """Counts round trips, and reports their times at the end."""

    def __init__(self, count: int) -> None:
        self._left = count + _WARM_UP
        self._count = count
        self._times_ns: list[int] = []
        self._begin_ns = 0

    def begin(self) -> None:
        self._begin_ns = monotonic_ns()

    def end(self) -> bool:
        """End a round trip; returns whether it was the last."""
        self._times_ns.append(monotonic_ns() - self._begin_ns)
        self._left -= 1
        if not self._left:
            _tell("taken", ns=self._times_ns[-self._count :])
        return not self._left


def _tell(event: str, **values: Any) -> None:
    from benchmarks.worker import tell

    tell(event, **values)


def _kind(name: str) -> Any:
    """The class with this name, for example example_interfaces.action.Fibonacci."""
    from importlib import import_module

    module, _, kind = name.rpartition(".")
    return getattr(import_module(module), kind)


def serve_actions() -> None:
    """Serve actions until the context ends."""
    import rclpy
    from rclpy.action import ActionServer

    Fibonacci = _kind("example_interfaces.action.Fibonacci")

    def execute(goal: Any) -> Any:
        feedback = Fibonacci.Feedback()
        for number in range(FEEDBACKS):
            feedback.sequence = [number]
            goal.publish_feedback(feedback)
        goal.succeed()
        return Fibonacci.Result()

    rclpy.init(args=[])
    node = rclpy.create_node("bench_server")
    ActionServer(node, Fibonacci, _GOAL, execute)
    _tell("ready")
    rclpy.spin(node)


def ask_for_actions(count: int) -> None:
    """Send one goal after another."""
    import rclpy
    from rclpy.action import ActionClient

    Fibonacci = _kind("example_interfaces.action.Fibonacci")

    rclpy.init(args=[])
    node = rclpy.create_node("bench_client")
    client = ActionClient(node, Fibonacci, _GOAL)
    client.wait_for_server()
    _tell("ready")
    sys.stdin.readline()
    rounds, heard = _Rounds(count), 0

    def hear(_: Any) -> None:
        nonlocal heard
        heard += 1

    is_over = False
    while not is_over:
        heard = 0
        rounds.begin()
        asked = client.send_goal_async(Fibonacci.Goal(order=FEEDBACKS), feedback_callback=hear)
        rclpy.spin_until_future_complete(node, asked)
        answered = asked.result().get_result_async()
        rclpy.spin_until_future_complete(node, answered)
        while heard < FEEDBACKS:
            rclpy.spin_once(node)
        is_over = rounds.end()


def serve_calls() -> None:
    """Serve calls until the context ends."""
    import rclpy

    def answer(request: Any, response: Any) -> Any:
        response.types = [len(name) for name in request.names]
        return response

    rclpy.init(args=[])
    node = rclpy.create_node("bench_server")
    node.create_service(_kind(_ASKED), _ASK, answer)
    _tell("ready")
    rclpy.spin(node)


def call(count: int) -> None:
    """Make one call after another."""
    import rclpy

    kind = _kind(_ASKED)
    rclpy.init(args=[])
    node = rclpy.create_node("bench_client")
    client = node.create_client(kind, _ASK)
    while not client.wait_for_service(timeout_sec=1.0):
        pass
    _tell("ready")
    sys.stdin.readline()
    rounds, is_over = _Rounds(count), False
    while not is_over:
        rounds.begin()
        asked = client.call_async(kind.Request(names=["abc"]))
        rclpy.spin_until_future_complete(node, asked)
        if list(asked.result().types) != [3]:
            raise ValueError(f"not the answer: {asked.result()}")
        is_over = rounds.end()


async def _pass_on(count: int) -> None:
    """Pass messages back and forth. `count` 0: this is the other end, which returns each message."""
    import asyncio

    import bus
    from bus.msg.std_msgs import String

    names = (_GOAL, _FEEDBACK) if count else (_FEEDBACK, _GOAL)
    is_over = asyncio.Event()
    rounds = _Rounds(count)
    left = 0

    def come(message: String) -> None:
        nonlocal left
        if count:
            left -= 2
            if left <= 0:
                if rounds.end():
                    is_over.set()
                    return
                left = MESSAGES
                rounds.begin()
        publisher.publish(message)

    async with bus.Node("bench_client" if count else "bench_server") as node:
        publisher = await node.create_publisher(String, names[0])
        await node.create_subscription(String, names[1], callback=come)
        if count:
            await publisher.wait_for_subscriptions()
        _tell("ready")
        if count:
            await asyncio.to_thread(sys.stdin.readline)
            left = MESSAGES
            rounds.begin()
            publisher.publish(String(data="x" * 64))
        await is_over.wait()


def pass_on(count: int) -> None:
    """Pass messages back and forth on the event loop that the bus uses."""
    import bus

    bus.run(_pass_on(count))


def _main() -> None:
    what, role, number = sys.argv[1:]
    count = int(number) if role == "client" else 0
    ways: dict[str, Callable[[], None]] = {
        "messages": lambda: pass_on(count),
        "action": lambda: ask_for_actions(count) if count else serve_actions(),
        "call": lambda: call(count) if count else serve_calls(),
    }
    ways[what]()


if __name__ == "__main__":
    _main()
