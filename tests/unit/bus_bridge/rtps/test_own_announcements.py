"""The announcements that a participant makes of itself."""

import pytest

from bus_bridge.rtps.announcements import departed, read_participant
from bus_bridge.rtps.ids import FAST_DDS, OUR_VENDOR, PARTICIPANT, PUBLICATIONS_WRITER, SPDP_WRITER
from bus_bridge.rtps.messages import Data, read_datagram, read_number64, write_head
from bus_bridge.rtps.own_announcements import ALIVE, OwnAnnouncements, Settings
from bus_bridge.rtps.parameters import Parameters, read_parameters

PREFIX = bytes(range(12))
PLACE = (("10.0.0.1", 7410),)
RELATED = 0x83


def made_by(*, is_client: bool) -> OwnAnnouncements:
    return OwnAnnouncements(Settings(PREFIX, PLACE, (), is_client=is_client, user_data=b"enclave=/;"))


def data_in(submessage: bytes) -> Data:
    (received,) = read_datagram(write_head(PREFIX) + submessage).received
    assert isinstance(received.submessage, Data)
    return received.submessage


def identity_in(inline: Parameters) -> tuple[bytes, int] | None:
    if RELATED not in inline:
        return None
    value = inline[RELATED][0]
    return value[:16], read_number64(value, 16, "<")


@pytest.mark.parametrize(
    ("is_client", "vendor", "role"), [(False, OUR_VENDOR, ""), (True, FAST_DDS, "SUPER_CLIENT")]
)
def test_calls(is_client: bool, vendor: bytes, role: str) -> None:
    made = made_by(is_client=is_client)
    call, last = data_in(made.alive()), data_in(made.disposal())
    assert call.payload == made.description
    told = read_participant(made.description, PREFIX)
    assert (told.vendor, told.role, told.addresses, told.user_data) == (vendor, role, PLACE, b"enclave=/;")
    assert made.vendor == vendor
    assert (call.number, last.number) == (ALIVE, ALIVE + 1)
    assert departed(last.payload, last.inline) == PREFIX + PARTICIPANT
    writer = PREFIX + SPDP_WRITER
    named = [(writer, 1), (writer, 2)] if is_client else [None, None]
    assert [identity_in(one.inline) for one in (call, last)] == named


@pytest.mark.parametrize("is_client", [False, True])
def test_announcements_of_endpoints(is_client: bool) -> None:
    made = made_by(is_client=is_client)
    guid, named = PREFIX + b"rrr4", (PREFIX + PUBLICATIONS_WRITER, 7) if is_client else None
    inline = made.inline(PUBLICATIONS_WRITER, 7)
    assert (identity_in(read_parameters(inline, "<").parameters) if inline else None) == named
    gone = read_parameters(made.inline(PUBLICATIONS_WRITER, 7, gone=guid), "<").parameters
    assert departed(None, gone) == guid and identity_in(gone) == named
