"""A reader or writer of our participant, as its user holds it. Pure."""

from bus_bridge.rtps.announcements import EndpointData
from bus_bridge.rtps.reader import Reader
from bus_bridge.rtps.writer import Writer

__all__ = ["Local"]


class Local:
    """A reader or writer of this participant, as `add_reader` and `add_writer` return it."""

    def __init__(self, data: EndpointData, end: Reader | Writer) -> None:
        self.data = data
        self.guid = data.guid
        self.reader = end if isinstance(end, Reader) else None
        self.writer = end if isinstance(end, Writer) else None
        self.announced = 0
        """The number of its announcement, among announcements of its kind."""

    @property
    def matched(self) -> list[bytes]:
        """GUIDs of the far endpoints that it is matched with."""
        if self.writer is not None:
            return self.writer.readers
        return [] if self.reader is None else self.reader.writers
