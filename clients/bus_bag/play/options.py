"""The options of a replay, as values."""

from collections.abc import Mapping, Sequence

import msgspec

from bus.qos import QoSProfile
from bus_bag.play.selection import Selection
from bus_bag.storage import Order

__all__ = ["PlayOptions"]


class PlayOptions(msgspec.Struct, frozen=True, kw_only=True):
    """The options of `bus bag play`. Times are nanoseconds."""

    rate: float = 1.0
    selection: Selection
    overrides: Mapping[str, QoSProfile] = {}
    """Topic -> profile for its publisher."""
    remaps: Sequence[str] = ()
    """Remappings such as `old:=new`."""
    is_looping: bool = False
    is_paused: bool = False
    stays_at_end: bool = False
    """At the end it pauses there, until a seek, a resume or `stop`. A loop never is at the end."""
    start_offset: int = 0
    duration: int | None = None
    until: int | None = None
    """A time of the bag. If there is also a duration, the later end counts."""
    delay: int = 0
    skipped_gap: int | None = None
    """Longer times without a message are skipped; None: none."""
    look_back: int = 0
    """A replay from the middle first publishes each topic's last message of so many nanoseconds before it."""
    clock_hz: float = 0.0
    clock_topics: frozenset[str] | None = None
    """Topics with a clock message before each of their messages; an empty set: before all messages."""
    order: Order = "log_time"
    read_ahead: int = 1000
    requests_source: str = ""
    """`service_introspection` or `client_introspection`: send the requests in events of services. Empty:
    publish the events."""
    acknowledged_within: int | None = None
    """Time to wait at the end until published messages have been sent; 0: no limit."""
    progress_hz: float = 3.0
    """Frequency of the line of progress; 0: never, negative: for each message."""
    has_keys: bool = True
    is_verbose: bool = False

    @property
    def has_clock(self) -> bool:
        """Whether the player publishes the time of the bag."""
        return self.clock_hz > 0 or self.clock_topics is not None

    def has_clock_before(self, topic: str) -> bool:
        """Whether the clock is published before each message of `topic`."""
        return self.clock_topics is not None and (not self.clock_topics or topic in self.clock_topics)
