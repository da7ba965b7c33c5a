"""The announcements that a participant makes of itself and of its endpoints. Pure.

Owns: their submessages and inline QoS. Must not know: which others there are, when an announcement is due.

Discovery Servers of Fast DDS serve participants of Fast DDS only. So a client of such servers says that it is
one. Its announcements have an identity: a server passes them on by writers of its own.
"""

from typing import Final, NamedTuple

from bus_bridge.rtps.announcements import ParticipantData, departure, identity, write_participant
from bus_bridge.rtps.far import USUAL_BOUNDS, Bounds
from bus_bridge.rtps.ids import FAST_DDS, OUR_VENDOR, PARTICIPANT, SPDP_READER, SPDP_WRITER, UNKNOWN_ENTITY
from bus_bridge.rtps.messages import write_data
from bus_bridge.rtps.parameters import Address

__all__ = ["CALL", "Presence", "Settings"]

CALL: Final = 1
"""The number of each call."""
_LAST_CALL: Final = 2
"""Fast DDS ignores an end with the number of a call."""
_LEASE_NS: Final = 20_000_000_000
_ROLE: Final = "SUPER_CLIENT"
"""A Discovery Server tells it of everything, other clients only of their own topics."""


class Settings(NamedTuple):
    """A participant's own data."""

    prefix: bytes
    """12 bytes, unique."""
    addresses: tuple[Address, ...]
    """Where it receives."""
    peers: tuple[Address, ...]
    """Where it announces itself: the multicast group, or addresses that participants may have."""
    is_client: bool = False
    """Whether the peers are Discovery Servers."""
    user_data: bytes = b""
    datagram_bytes: int = 16_000
    fragment_bytes: int = 60_000
    """Over a network of its own, both should fit into one of its packets."""
    bounds: Bounds = USUAL_BOUNDS


class Presence:
    """What the participant with these settings says of itself."""

    def __init__(self, settings: Settings) -> None:
        self._prefix = settings.prefix
        self._is_client = settings.is_client
        self.vendor = FAST_DDS if settings.is_client else OUR_VENDOR
        self.description = write_participant(
            ParticipantData(
                settings.prefix,
                self.vendor,
                settings.addresses,
                settings.addresses,
                _LEASE_NS,
                settings.user_data,
                _ROLE if settings.is_client else "",
            )
        )
        """The payload of the announcement of the participant."""

    def call(self) -> bytes:
        """The announcement of the participant, for whoever receives it."""
        inline = self.inline(SPDP_WRITER, CALL)
        return write_data(UNKNOWN_ENTITY, SPDP_WRITER, CALL, self.description, inline)

    def last_call(self) -> bytes:
        """The announcement that the participant goes."""
        inline = self.departure(self._prefix + PARTICIPANT, SPDP_WRITER, _LAST_CALL)
        return write_data(SPDP_READER, SPDP_WRITER, _LAST_CALL, None, inline)

    def inline(self, writer: bytes, number: int) -> bytes:
        """Inline QoS of the announcement with that number of one of its writers."""
        return identity(self._prefix + writer, number) if self._is_client else b""

    def departure(self, guid: bytes, writer: bytes, number: int) -> bytes:
        """Inline QoS of an announcement that the participant or an endpoint of it has gone."""
        if self._is_client:
            return departure(guid, self._prefix + writer, number)
        return departure(guid)
