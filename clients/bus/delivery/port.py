"""The Port: delivery's interface to its connection and its event loop.

All output, waiting and timers of delivery go through it. So delivery knows no event loop and no socket, and
tests run it with a list and a clock that they set by hand. `bus.link.link.Link` has these methods.
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
"""Time after which matches of the last broker count as gone, if the new broker has not made them."""


class Owner(Protocol):
    """The publisher or subscription whose samples delivery handles."""

    id: int
    """The endpoint's number at the broker; 0: the broker does not know it at the moment."""
    topic_name: str
    qos: QoSProfile
    support: TypeSupport[Any]
    refusal: BusError | None

    def hand_over(self) -> None: ...

    def totals(self) -> m.Report: ...


class Timer(Protocol):
    """A scheduled call."""

    def cancel(self) -> object: ...


class Waiters(Protocol):
    """Tasks that wait for a change. Each checks whether it can continue. False: there are none."""

    def __bool__(self) -> bool: ...

    async def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the next `release`; False if the time is over first. Raises the error of `fail`."""

    def release(self) -> None: ...

    def fail(self, reason: BaseException) -> None: ...


class ReaderProcess(Protocol):
    """A process that reads rings of this one."""

    @property
    def bell(self) -> "shm.native.Bell": ...

    @property
    def is_here(self) -> bool:
        """Whether it is this process's own event loop."""

    def is_alive(self) -> bool:
        """Whether the process still runs; True also if that is unknown."""


class ShmPort(Protocol):
    """This process's side of shared memory: its doorbell, and the slots of its readers."""

    @property
    def readers(self) -> "shm.native.Readers": ...

    # --- the other side

    def reader_process(self, segment: Descriptor, doorbell: Descriptor, pid: int, /) -> ReaderProcess:
        """The process with this readers' segment. Raises OSError or ValueError with the fault."""

    def writer_doorbell(self, doorbell: Descriptor, /) -> Descriptor:
        """One descriptor for all received descriptors of the same doorbell."""

    # --- readers

    def allot_slot(self) -> int | None:
        """A slot for one match; None if all are in use."""

    def give_back(self, slot: int, /) -> None: ...

    def poll_soon(self) -> None:
        """Check the rings once, even without a ring of the doorbell."""

    def poll(self, owner: object, time_ns: int, /) -> None:
        """Poll without sleeping for up to `time_ns` after each message; 0: stop that."""

    # --- writers that wait for room

    def wait_for_room(self, writer: object, look: Callable[[], None], /) -> None:
        """Call `look` at each ring of the doorbell, until `stop_waiting`."""

    def wake_waiting(self, writer: object, /) -> None: ...

    def stop_waiting(self, writer: object, /) -> None: ...


class Port(Protocol):
    """One connection to a broker, which may be away for a while, and its event loop."""

    # --- to the broker

    last_sent_ns: int
    """Time of the last frame sent at once, without gathering."""

    def send_about(
        self, owner: Owner, message: m.Message | bytes, descriptors: tuple[Descriptor, ...] = (), /
    ) -> None:
        """Send a message (or frame) about `owner`; does nothing if the broker does not know it now."""

    def send_now(self, frame: Buffer, /) -> bool:
        """Send a data frame at once if nothing is queued; returns whether it was sent."""

    def gather(self, owner: Owner, /) -> None:
        """Have `owner` hand over the run that it has begun when the turn of the loop ends."""

    def make_ready(self, queue: RunQueue, /) -> None:
        """Schedule a `queue` that has runs for the broker."""

    def flush(self) -> None:
        """Send queued data, as far as the socket accepts it."""

    def wrote(self) -> None:
        """Note that the socket accepts bytes again: queued data was sent, or can be sent now."""

    async def wait_for_drain(self, queue: RunQueue, /) -> None:
        """Wait until the socket has accepted everything in `queue`."""

    def report(self, owner: Owner, /) -> None:
        """Report the changed counters of `owner` to the broker soon."""

    def is_quiet(self) -> bool:
        """Whether everything that the broker has sent was read; True also without a broker."""

    # --- shared memory

    @property
    def shm_context(self) -> ShmPort | None:
        """The process's side of shared memory; None if no memory is shared."""

    # --- the event loop

    @property
    def is_shared(self) -> bool:
        """Whether any thread with the lock may use the objects of this loop; else only the loop's thread."""

    @property
    def owns_thread(self) -> Callable[[], bool]:
        """Whether the calling thread may use the objects of this loop."""

    @property
    def now_ns(self) -> Callable[[], int]:
        """The monotonic clock, by which samples are stamped."""

    def soon(self, call: Callable[..., object], /, *args: Any) -> object:
        """Make a call after this turn of the loop."""

    def soon_threadsafe(self, call: Callable[..., object], /, *args: Any) -> object:
        """As `soon`, from any thread. Raises RuntimeError if the loop has ended."""

    def later(self, delay_s: float, call: Callable[..., object], /, *args: Any) -> Timer: ...

    async def turn(self) -> None:
        """Give the loop a turn."""

    def waiters(self) -> Waiters: ...

    def start(self, work: Coroutine[Any, Any, None], name: str, /) -> Callable[[], object]:
        """Run `work` as a task. Returns a function that cancels it, but not if the task itself calls that."""
