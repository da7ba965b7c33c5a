"""Calls between this bus and ROS 2, in both directions: each has one end.

Owns: the pairs of a call on one side and the same call on the other, until its end. Two functions stand for
the bus: one takes the messages of a topic of requests or replies, and `publish` is for the other topic.
`publish` gets the message, and the GUID of the far endpoint that it comes from. Must not know: nodes,
endpoints of the bus, rules.

Each call ends once: with an answer, or with an error. ROS 2 has no errors of services: its clients wait as
long as they want.
"""

import asyncio
from collections.abc import Callable
from typing import Final

from bus_bridge.errors import BridgeError
from bus_bridge.ros2.calls import NoServer, RequestId, Services
from bus_bridge.ros2.open_requests import OpenRequest, OpenRequests
from bus_bridge.ros2.service_types import Call, ServiceTypes

__all__ = ["CallsFromRos", "CallsToRos", "Publish"]

Publish = Callable[[bytes, bytes], object]

_MOST_TASKS: Final = 1000
_FEEDBACK_FIRST_S: Final = 0.02
"""The delay of a goal's result. The last feedback goes by the carrier of topics. If it came after the result,
the client would drop it."""
_PATIENCE_S: Final = 10.0
"""How long a call waits for a server that has just come, or comes back."""


class CallsFromRos:
    """A server of this bus, offered to ROS 2's clients. `publish` takes messages of the topic of requests.

    On the bus, the client of a call has the GUID of the far client's writer. `requests`: the requests to
    all servers of the service, if this bus has several.
    """

    def __init__(
        self,
        services: Services,
        service: str,
        types: ServiceTypes,
        publish: Publish,
        user_data: bytes = b"",
        requests: OpenRequests | None = None,
    ) -> None:
        self.failed = 0
        """Calls that get no answer: the server here answered with an error, or did not know them."""
        self._services = services
        self._service = service
        self._result_pause_s = _result_pause_s(service)
        self._types = types
        self._publish = publish
        self._requests = OpenRequests() if requests is None else requests
        self._results: dict[tuple[bytes, int], tuple[asyncio.TimerHandle, OpenRequest, bytes]] = {}
        """Results that wait for the last feedback, with their timers, by client and number."""
        self.server = services.serve(service, types.type_name, self._request, user_data)

    @property
    def waiting(self) -> int:
        """The number of calls without an end."""
        return len(self._requests)

    def reply(self, payload: bytes) -> None:
        """Take a message of the topic of replies. Messages for clients of this bus are ignored.

        Raises BridgeError if it is not an answer of this service.
        """
        answer = self._types.read_reply(payload)
        key = answer.client, answer.number
        request = self._requests.pop(key)
        if request is None:
            return
        if answer.cdr is None:
            self._fail(request, answer.error or "its server does not know the call any more")
        elif self._result_pause_s:
            loop = asyncio.get_running_loop()
            timer = loop.call_later(self._result_pause_s, self._send_result, key)
            self._results[key] = timer, request, answer.cdr
        else:
            request.answer(answer.cdr)

    def close(self) -> None:
        """Withdraw the service from ROS 2. Calls that no other server of ours has get no answer; results that
        wait are sent now."""
        for key in list(self._results):
            self._send_result(key)
        for request in self._requests.pop_of(self.server):
            self._fail(request, "its server has gone")
        self.server.close()

    def _send_result(self, key: tuple[bytes, int]) -> None:
        timer, request, cdr = self._results.pop(key)
        timer.cancel()
        request.answer(cdr)

    def _request(self, request: RequestId, cdr: bytes) -> None:
        key = self._requests.add(request, self.server)
        if key is None:
            return
        try:
            payload = self._types.write_request(*key, cdr)
        except BridgeError as error:
            if (wrong := self._requests.pop(key)) is not None:
                self._fail(wrong, str(error))
            return
        if (oldest := self._requests.pop_oldest()) is not None:
            self._fail(oldest, "too many later calls have no answer either")
        self._publish(request.writer, payload)

    def _fail(self, request: OpenRequest, why: str) -> None:
        self.failed += 1
        request.drop()
        self._services.warn(f"a call of {self._service} by a node of ROS 2 gets no answer: {why}")


class CallsToRos:
    """A client of this bus, in ROS 2. `publish` takes messages of the topic of replies.

    If a message comes from no far server, because it says why there is no answer, its GUID is empty.
    """

    def __init__(
        self,
        services: Services,
        service: str,
        types: ServiceTypes,
        publish: Publish,
        user_data: bytes = b"",
    ) -> None:
        self.failed = 0
        """Calls that were answered with an error."""
        self._service = service
        self._result_pause_s = _result_pause_s(service)
        self._types = types
        self._publish = publish
        self._tasks: dict[tuple[bytes, int], asyncio.Task[None]] = {}
        self._entrance = asyncio.Lock()
        """A call holds it while it waits for a server, so no later call goes first."""
        self.client = services.make_client(service, types.type_name, user_data)

    @property
    def waiting(self) -> int:
        """The number of calls without an end."""
        return len(self._tasks)

    def request(self, payload: bytes) -> None:
        """Take a message of the topic of requests. Raises BridgeError if it is not a request of this
        service."""
        call = self._types.read_request(payload)
        key = call.client, call.number
        if key in self._tasks:
            return  # it was sent once more, or its client asks: the answer comes
        if call.cdr is None:
            self._publish(b"", self._types.write_denial(*key))
        elif len(self._tasks) >= _MOST_TASKS:
            self._fail(call, f"{_MOST_TASKS} calls of {self._service} wait for an answer, which is the limit")
        else:
            task = asyncio.get_running_loop().create_task(self._run(call, call.cdr))
            self._tasks[key] = task
            task.add_done_callback(lambda done: self._forget(key, done))

    def close(self) -> None:
        """End the client in ROS 2. Calls without an answer are given up."""
        for task in list(self._tasks.values()):
            task.cancel()
        self.client.close()

    async def _run(self, call: Call, cdr: bytes) -> None:
        try:
            async with asyncio.timeout(_PATIENCE_S), self._entrance:
                await self.client.wait_until_ready()
        except TimeoutError:
            self._fail(call, f"no server of {self._service} in ROS 2")
            return
        except NoServer as error:
            self._fail(call, str(error))
            return
        try:
            answer = await self.client.call(cdr)
            await asyncio.sleep(self._result_pause_s)
            reply = self._types.write_reply(call.client, call.number, answer.cdr)
        except BridgeError as error:
            self._fail(call, str(error))
            return
        self._end(call, answer.writer, reply)

    def _fail(self, call: Call, why: str) -> None:
        self.failed += 1
        self._end(call, b"", self._types.write_error(call.client, call.number, why))

    def _end(self, call: Call, server: bytes, reply: bytes) -> None:
        self._tasks.pop((call.client, call.number), None)
        self._publish(server, reply)

    def _forget(self, key: tuple[bytes, int], task: asyncio.Task[None]) -> None:
        if self._tasks.get(key) is task:
            del self._tasks[key]


def _result_pause_s(service: str) -> float:
    return _FEEDBACK_FIRST_S if service.endswith("/_action/get_result") else 0.0
