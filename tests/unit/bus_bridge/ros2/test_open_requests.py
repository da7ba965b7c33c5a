"""bus_bridge.ros2.open_requests: a request that several servers receive is one request, and it ends once."""

from collections.abc import Callable

import pytest

from bus_bridge.ros2 import open_requests as module
from bus_bridge.ros2.calls import RequestId
from bus_bridge.ros2.open_requests import OpenRequests

WRITER = b"w" * 16


class ListServer:
    """One of our servers in ROS 2. `can_answer`: whether the client still takes answers of it."""

    guids = (b"s" * 16, b"p" * 16)

    def __init__(self, *, can_answer: bool = True) -> None:
        self.can_answer = can_answer
        self.answered: list[tuple[RequestId, bytes]] = []
        self.dropped: list[RequestId] = []

    def answer(self, request: RequestId, cdr: bytes) -> bool:
        if self.can_answer:
            self.answered.append((request, cdr))
        return self.can_answer

    def drop(self, request: RequestId) -> None:
        self.dropped.append(request)

    def close(self) -> None:
        pass


def request(number: int) -> RequestId:
    return RequestId(b"c" * 16, number, WRITER)


def added(requests: OpenRequests, one: RequestId, server: ListServer) -> tuple[bytes, int]:
    key = requests.add(one, server)
    assert key is not None
    return key


def test_a_request_has_one_number_and_one_answer() -> None:
    requests, first, second = OpenRequests(), ListServer(), ListServer()
    assert added(requests, request(7), first) == (WRITER, 1)
    assert requests.add(request(7), second) is None
    assert added(requests, request(8), second) == (WRITER, 2)
    found = requests.pop((WRITER, 1))
    assert found is not None
    found.answer(b"cdr")
    assert first.answered == [(request(7), b"cdr")]
    assert (second.answered, second.dropped) == ([], [request(7)])
    assert requests.pop((WRITER, 1)) is None
    assert len(requests) == 1


def test_another_server_answers_if_the_first_one_can_not() -> None:
    requests, first, second = OpenRequests(), ListServer(can_answer=False), ListServer()
    key = added(requests, request(7), first)
    requests.add(request(7), second)
    found = requests.pop(key)
    assert found is not None
    found.answer(b"cdr")
    assert second.answered == [(request(7), b"cdr")] and second.dropped == []


def test_a_server_that_receives_an_ended_request_drops_it() -> None:
    requests, first, late = OpenRequests(), ListServer(), ListServer()
    requests.pop(added(requests, request(7), first))
    assert requests.add(request(7), late) is None
    assert late.dropped == [request(7)] and len(requests) == 0


def test_a_closed_server_ends_the_requests_that_no_other_has() -> None:
    requests, first, second = OpenRequests(), ListServer(), ListServer()
    for number in (1, 2, 3):
        requests.add(request(number), first)
    requests.add(request(2), second)
    assert [one.request for one in requests.pop_of(first)] == [request(1), request(3)]
    assert len(requests) == 1
    assert [one.request for one in requests.pop_of(second)] == [request(2)]
    assert len(requests) == 0


def test_above_the_most_the_oldest_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST", 2)
    requests, server = OpenRequests(), ListServer()
    ended: list[RequestId] = []
    for number in range(1, 5):
        requests.add(request(number), server)
        if (oldest := requests.pop_oldest()) is not None:
            ended.append(oldest.request)
    assert ended == [request(1), request(2)]


def test_so_many_ended_requests_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST_ENDED", 2)
    requests, server = OpenRequests(), ListServer()
    is_known: Callable[[int], bool] = lambda number: requests.add(request(number), server) is None  # noqa: E731
    for number in (1, 2, 3):
        requests.pop(added(requests, request(number), server))
    assert is_known(2) and is_known(3)
    assert not is_known(1)
