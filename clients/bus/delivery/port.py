"""What delivery needs of the connection and the event loop that it works for: a Port.

Whatever leaves here, waits, or is due later goes through it. So delivery knows no event loop and no socket,
and tests run it with a list and a clock that they set by hand. `bus.link.link.Link` is one, without knowing.
"""

from collections.abc import Callable, Coroutine
from typing import Any, Protocol

from bus import shm
from bus.base.descriptor import Descriptor
from bus.errors import BusError
from bus.qos import QoSProfile
from bus.types.support import TypeSupport
from bus.wire import messages as m
from bus.wire.runs import Buffer, RunQueue

RETURN_S = 10.0
"""After a new broker came: how long until matches of the last one that are not back count as gone."""


class Owner(Protocol):
    """The publisher or subscription that delivery works for."""

    id: int
    """The broker's number; 0: it does not know the endpoint at the moment."""
    topic_name: str
    qos: QoSProfile
    support: TypeSupport[Any]
    refusal: BusError | None

    def hand_over(self) -> None: ...

    def totals(self) -> m.Report: ...


class Timer(Protocol):
    """A call that is due later."""

    def cancel(self) -> object: ...


class Waiters(Protocol):
    """Tasks that wait for a change, and look for themselves whether it is theirs. False: there are none."""

    def __bool__(self) -> bool: ...

    async def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the next `release`; False if the time is over first. Raises what `fail` was given."""

    def release(self) -> None: ...

    def fail(self, reason: BaseException) -> None: ...


class ReaderProcess(Protocol):
    """A process that reads rings of this one."""

    @property
    def bell(self) -> "shm.native.Bell": ...

    @property
    def is_here(self) -> bool:
        """Whether it is this event loop itself."""

    def is_alive(self) -> bool:
        """Whether the process still runs; True also if that can't be found out."""


class ShmPort(Protocol):
    """What this process shares with others: its doorbell, and the slots of its readers."""

    @property
    def readers(self) -> "shm.native.Readers": ...

    # --- the other side

    def reader_process(self, segment: Descriptor, doorbell: Descriptor, pid: int, /) -> ReaderProcess:
        """The process that has this readers' segment. Raises OSError or ValueError, saying what is wrong."""

    def writer_doorbell(self, doorbell: Descriptor, /) -> Descriptor:
        """One descriptor for all that came of the same doorbell."""

    # --- readers

    def allot_slot(self) -> int | None:
        """A slot for one match; None if all are in use."""

    def give_back(self, slot: int, /) -> None: ...

    def poll_soon(self) -> None:
        """Look into the rings once, rung or not."""

    def poll(self, owner: object, time_ns: int, /) -> None:
        """Look without sleeping for up to `time_ns` after each message; 0: not any more."""

    # --- writers that wait for room

    def wait_for_room(self, writer: object, look: Callable[[], None], /) -> None:
        """Call `look` at each ring of the doorbell, until `stop_waiting`."""

    def wake_waiting(self, writer: object, /) -> None: ...

    def stop_waiting(self, writer: object, /) -> None: ...


class Port(Protocol):
    """One connection to a broker, which may be away for a while, and the event loop that it lives on."""

    # --- to the broker

    last_sent_ns: int
    """When a publisher last sent past the gathering."""

    def send_about(
        self, owner: Owner, message: m.Message | bytes, descriptors: tuple[Descriptor, ...] = (), /
    ) -> None:
        """Send a message (or frame) about `owner`; nothing where the broker does not know it now."""

    def send_now(self, frame: Buffer, /) -> bool:
        """Send a data frame at once if nothing is queued; returns whether it was sent."""

    def gather(self, owner: Owner, /) -> None:
        """`owner` has begun a run: it is to hand it over when the turn of the loop ends."""

    def make_ready(self, queue: RunQueue, /) -> None:
        """`queue` has runs for the broker."""

    def flush(self) -> None:
        """Send queued data, as far as the socket accepts it."""

    def wrote(self) -> None:
        """The socket takes bytes again: what waited was sent, or can be now."""

    async def wait_for_drain(self, queue: RunQueue, /) -> None:
        """Wait until the socket has accepted everything in `queue`."""

    def report(self, owner: Owner, /) -> None:
        """The counters of `owner` have changed: report them to the broker soon."""

    def is_quiet(self) -> bool:
        """Whether everything that the broker has sent was read; True also if there is none."""

    # --- shared memory

    @property
    def shm_context(self) -> ShmPort | None:
        """None if no memory is shared."""

    # --- the event loop

    @property
    def is_shared(self) -> bool:
        """Whether any thread may use what lives here, while it holds a lock; else the loop's thread only."""

    @property
    def owns_thread(self) -> Callable[[], bool]:
        """Whether the calling thread may use what lives here."""

    @property
    def now_ns(self) -> Callable[[], int]:
        """The monotonic clock, by which samples are stamped."""

    def soon(self, call: Callable[..., object], /, *args: Any) -> object:
        """Call after this turn of the loop."""

    def soon_threadsafe(self, call: Callable[..., object], /, *args: Any) -> object:
        """As `soon`, from any thread. Raises RuntimeError if the loop has ended."""

    def later(self, delay_s: float, call: Callable[..., object], /, *args: Any) -> Timer: ...

    async def turn(self) -> None:
        """Let the loop have a turn."""

    def waiters(self) -> Waiters: ...

    def start(self, work: Coroutine[Any, Any, None], name: str, /) -> Callable[[], object]:
        """Run `work` as a task; returns what cancels it, unless the task itself calls that."""
