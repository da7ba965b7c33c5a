"""Bounds on the work that a message costs a publisher or subscriber process: see `stepcount`."""

from pathlib import Path

import pytest

import bus
from bus.msg.std_msgs import String
from bus.shm import has_core
from callcount import CallCounter
from stepcount import allocations, steps, system_calls

pytestmark = [pytest.mark.landing, pytest.mark.usefixtures("daemon")]

by_shared_memory = pytest.mark.parametrize("route", [pytest.param("shm", id="memory")], indirect=True)
by_socket = pytest.mark.parametrize("route", ["socket"], indirect=True)
natively = pytest.mark.skipif(not has_core(), reason="the native core was not built")
on_both_loops = pytest.mark.parametrize(
    "loop", ["uvloop", pytest.param("asyncio", marks=pytest.mark.nightly)]
)


@by_shared_memory
@on_both_loops
def test_steps_of_a_publisher_by_shared_memory(route: str, loop: str) -> None:
    bytecodes, calls = steps("publisher", loop)
    assert 5 <= bytecodes <= 24
    assert calls == 1


@by_shared_memory
@on_both_loops
@pytest.mark.parametrize("message_lost", [False, True])
def test_steps_of_a_subscriber_by_shared_memory(route: str, loop: str, message_lost: bool) -> None:
    bytecodes, calls = steps("subscriber", loop, message_lost=message_lost)
    assert 10 <= bytecodes <= 40
    assert calls == 2  # the doorbell's, and the user's callback


@by_shared_memory
def test_allocations_by_shared_memory(route: str, tmp_path: Path) -> None:
    assert allocations("publisher", tmp_path) <= 2
    assert 2 <= allocations("subscriber", tmp_path) <= 4  # two are the message and its text


@by_shared_memory
def test_system_calls_by_shared_memory(route: str, tmp_path: Path) -> None:
    assert system_calls("publisher", tmp_path) == 1  # the doorbell
    assert system_calls("subscriber", tmp_path) == 2  # the wait, and the doorbell


@natively
@by_socket
@on_both_loops
def test_steps_of_a_publisher_by_socket(route: str, loop: str) -> None:
    bytecodes, calls = steps("publisher", loop)
    assert 100 <= bytecodes <= 200
    assert calls <= 6


@natively
@by_socket
@on_both_loops
@pytest.mark.parametrize("message_lost", [False, True])
def test_steps_of_a_subscriber_by_socket(route: str, loop: str, message_lost: bool) -> None:
    bytecodes, calls = steps("subscriber", loop, message_lost=message_lost)
    assert 100 <= bytecodes <= 510
    assert calls <= 15


@by_socket
def test_system_calls_by_socket(route: str, tmp_path: Path) -> None:
    assert system_calls("publisher", tmp_path) == 1  # the send
    assert system_calls("subscriber", tmp_path) == 2  # the wait, and the read


@by_shared_memory
@pytest.mark.parametrize(("with_info", "most", "most_calls"), [(False, 66, 2), (True, 270, 12)])
def test_a_script_that_listens_waits_in_one_native_call(
    route: str, with_info: bool, most: int, most_calls: int, tmp_path: Path
) -> None:
    bytecodes, calls = steps("subscriber", "none", with_info=with_info)
    assert 10 <= bytecodes <= most
    assert calls <= most_calls
    assert (
        system_calls("subscriber", tmp_path, "none", with_info=with_info) == 2
    )  # the wait, and the doorbell


@by_shared_memory
def test_steps_of_an_executor(route: str) -> None:
    bytecodes, calls = steps("subscriber", "rclpy")
    assert (
        100 <= bytecodes <= 595
    )  # eleven of them note the call, so that nested spins of all threads know it
    assert calls <= 12  # three between the wake-up and the user's callback


@by_shared_memory
def test_steps_of_a_thread_of_an_executor(route: str) -> None:
    bytecodes, calls = steps("subscriber", "rclpy", threads=True)
    assert 100 <= bytecodes <= 510
    assert calls <= 21


# The bounds have three calls to spare: `make test` sets BUS_NATIVE, which costs calls when it is read.
@natively
@pytest.mark.parametrize(("route", "most"), [("shm", 94), ("socket", 88)], indirect=["route"])
async def test_calls_of_a_subscription_that_is_made(route: str, most: int) -> None:
    async with bus.Node("maker", rosout=False, arguments=[]) as node:
        for number in range(3):  # so that one-time work is done
            await node.create_subscription(String, f"warm_up_{number}", 10, lambda message: None)
        with CallCounter() as counter:
            await node.create_subscription(String, "made", 10, lambda message: None)
    assert 40 <= counter.python <= most


@natively
@pytest.mark.parametrize(("route", "most"), [("shm", 140), ("socket", 114)], indirect=["route"])
async def test_calls_of_a_publisher_that_is_made(route: str, most: int) -> None:
    async with bus.Node("maker", rosout=False, arguments=[]) as node:
        for number in range(3):
            await node.create_publisher(String, f"warm_up_{number}", 10)
        calls = []
        for number in range(5):  # on a busy machine a heartbeat may fall into one
            with CallCounter() as counter:
                await node.create_publisher(String, f"made_{number}", 10)
            calls.append(counter.python)
    assert 40 <= min(calls) <= most
