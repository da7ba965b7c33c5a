"""The announcements that a participant makes of itself and of its endpoints, and its settings. Pure.

Owns: their submessages and inline QoS. Must not know: when an announcement is due.

Discovery Servers of Fast DDS ignore participants of other vendors. So a client of such servers announces the
vendor id of Fast DDS. Its announcements have an identity, because a server passes them on by its own writers.
"""

from typing import Final, NamedTuple

from bus_bridge.rtps.announcements import ParticipantData, Related, inline_qos, write_participant
from bus_bridge.rtps.far import USUAL_BOUNDS, Bounds
from bus_bridge.rtps.ids import FAST_DDS, OUR_VENDOR, PARTICIPANT, SPDP_READER, SPDP_WRITER, UNKNOWN_ENTITY
from bus_bridge.rtps.messages import write_data
from bus_bridge.rtps.parameters import Address

__all__ = ["ALIVE", "OwnAnnouncements", "Settings"]

ALIVE: Final = 1
"""The number of the first announcement of the participant."""
_LEASE_NS: Final = 20_000_000_000
_SUPER_CLIENT: Final = "SUPER_CLIENT"
"""A Discovery Server tells it of everything, other clients only of their own topics."""


class Settings(NamedTuple):
    """A participant's own data."""

    prefix: bytes
    """12 bytes, unique."""
    addresses: tuple[Address, ...]
    """Where it receives."""
    peers: tuple[Address, ...]
    """Addresses for its announcements: the multicast group, or addresses that participants may have."""
    is_client: bool = False
    """Whether the peers are Discovery Servers."""
    user_data: bytes = b""
    datagram_bytes: int = 16_000
    fragment_bytes: int = 60_000
    """With a real network, both should fit into one of its packets."""
    bounds: Bounds = USUAL_BOUNDS


class OwnAnnouncements:
    """The announcements of the participant with these settings."""

    def __init__(self, settings: Settings) -> None:
        self._prefix = settings.prefix
        self._is_client = settings.is_client
        self.number = ALIVE
        """The number of the announcement of the participant."""
        self.vendor = FAST_DDS if settings.is_client else OUR_VENDOR
        self.description = write_participant(
            ParticipantData(
                settings.prefix,
                self.vendor,
                settings.addresses,
                settings.addresses,
                _LEASE_NS,
                settings.user_data,
                _SUPER_CLIENT if settings.is_client else "",
            )
        )
        """The payload of the announcement of the participant."""

    def alive(self) -> bytes:
        """The announcement of the participant, for all that receive it."""
        inline = self.inline(SPDP_WRITER, self.number)
        return write_data(UNKNOWN_ENTITY, SPDP_WRITER, self.number, self.description, inline)

    def disposal(self) -> bytes:
        """The announcement that the participant leaves. Fast DDS ignores it with a number that it knows."""
        number = self.number + 1
        inline = self.inline(SPDP_WRITER, number, gone=self._prefix + PARTICIPANT)
        return write_data(SPDP_READER, SPDP_WRITER, number, None, inline)

    def inline(self, writer: bytes, number: int, *, gone: bytes | None = None) -> bytes:
        """Inline QoS of the announcement with that number of one of its writers.

        `gone`: the GUID of the participant, or of an endpoint of it, that has gone.
        """
        related = Related(self._prefix + writer, number) if self._is_client else None
        return inline_qos(related=related, gone=gone)
