"""Services with a participant of Cyclone DDS, as rmw_cyclonedds makes its samples, beside one of ours.

The participant was written from rmw_cyclonedds's sources: 16 bytes before the body, and no inline QoS.
"""

import asyncio
import struct
from collections.abc import AsyncIterator

import pytest

from bridged_world import until
from bus_bridge.dds.services import Services
from bus_bridge.ros2.calls import RequestId
from bus_bridge.rtps.announcements import EndpointData, ParticipantData
from bus_bridge.rtps.ids import CYCLONE
from bus_bridge.rtps.reader import Arrived
from bus_bridge.rtps.running import RunningParticipant
from conftest import WAIT_S
from ports import own_domain

DOMAIN = own_domain()
SERVICE, TYPE = "/s", "std_srvs/srv/Trigger"
CDR = b"\0\1\0\0"
CLIENT = b"cyclone1"


class Cyclone:
    """Its server answers each request with the same body and `?`."""

    def __init__(self) -> None:
        self.participant = RunningParticipant(DOMAIN, self, lambda endpoint: True)
        self.answers: list[bytes] = []
        self._types = "std_srvs::srv::dds_::Trigger_Request_", "std_srvs::srv::dds_::Trigger_Response_"

    def make_client(self) -> None:
        request, response = self._types
        self.replies = self.participant.add_reader("rr/sReply", response, self._answered)
        self.requests = self.participant.add_writer("rq/sRequest", request)

    def ask(self, number: int, body: bytes) -> None:
        header = CLIENT + struct.pack("<q", number)
        self.participant.write(self.requests, CDR + header + body)

    def serve(self) -> None:
        request, response = self._types
        self.participant.add_reader("rq/sRequest", request, self._asked)
        self._writer = self.participant.add_writer("rr/sReply", response)

    def _answered(self, one: Arrived) -> None:
        assert one.payload is not None and not one.inline
        self.answers.append(one.payload)

    def _asked(self, one: Arrived) -> None:
        assert one.payload is not None
        self.participant.write(self._writer, one.payload + b"?")

    def participant_added(self, data: ParticipantData) -> None: ...
    def participant_removed(self, prefix: bytes) -> None: ...
    def endpoint_added(self, endpoint: EndpointData, vendor: bytes) -> None: ...
    def endpoint_removed(self, endpoint: EndpointData) -> None: ...
    def warn(self, text: str) -> None:
        raise AssertionError(text)


@pytest.fixture
async def cyclone(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Cyclone]:
    with monkeypatch.context() as patch:
        for module in ("own_announcements", "running"):
            patch.setattr(f"bus_bridge.rtps.{module}.OUR_VENDOR", CYCLONE)
        made = Cyclone()
    yield made
    made.participant.close()


@pytest.fixture
async def ours() -> AsyncIterator[Services]:
    warnings: list[str] = []
    made = Services(DOMAIN, warnings.append)
    yield made
    made.close()
    assert warnings == []


async def test_clients_of_both_vendors_at_once(cyclone: Cyclone, ours: Services) -> None:
    def on_request(request: RequestId, cdr: bytes) -> None:
        assert server.answer(request, cdr + b"!")

    server = ours.serve(SERVICE, TYPE, on_request)
    other = Services(DOMAIN, pytest.fail)
    try:
        client = other.make_client(SERVICE, TYPE)
        cyclone.make_client()
        await asyncio.wait_for(client.wait_until_ready(), WAIT_S)
        await until(lambda: cyclone.replies.matched and len(server._writer.matched) == 2)
        for number in range(1, 6):
            cyclone.ask(number, b"c%d" % number)
            answer = await asyncio.wait_for(client.call(CDR + b"f%d" % number), WAIT_S)
            assert answer.cdr == CDR + b"f%d!" % number
        await until(lambda: len(cyclone.answers) == 5)
        headers = [CLIENT + struct.pack("<q", number) for number in range(1, 6)]
        assert cyclone.answers == [CDR + one + b"c%d!" % at for at, one in enumerate(headers, 1)]
        assert (client.faulty, client.late, server.faulty) == (0, 0, 0)
    finally:
        other.close()


async def test_an_answer_waits_for_the_announcement_of_a_reader(
    cyclone: Cyclone, ours: Services, monkeypatch: pytest.MonkeyPatch
) -> None:
    requests: list[tuple[RequestId, bytes]] = []
    server = ours.serve(SERVICE, TYPE, lambda request, cdr: requests.append((request, cdr)))
    cyclone.make_client()
    await until(lambda: cyclone.replies.matched and server._writer.matched and server._reader.matched)
    cyclone.ask(1, b"one")
    await until(lambda: requests)
    monkeypatch.setattr(type(server._writer), "matched", [])
    assert server.answer(*requests[0])
    assert [*server._unmatched] == [cyclone.requests.guid]
    monkeypatch.undo()
    server.reader_matched(cyclone.replies.guid)
    await until(lambda: cyclone.answers)
    assert not server._unmatched


async def test_a_server_of_cyclone(cyclone: Cyclone, ours: Services) -> None:
    cyclone.serve()
    client = ours.make_client(SERVICE, TYPE)
    await asyncio.wait_for(client.wait_until_ready(), WAIT_S)
    calls = [asyncio.wait_for(client.call(CDR + b"%d" % number), WAIT_S) for number in range(20)]
    assert [one.cdr for one in await asyncio.gather(*calls)] == [CDR + b"%d?" % n for n in range(20)]
    assert (client.faulty, client.late) == (0, 0)
