"""The shared memory of a link: its doorbell, by which other processes wake it, and its readers' segment.

There is one of each, for any number of endpoints. Owns the slots of the segment, and the processes on the
other side. Must not know the contents of rings.
"""

import asyncio
import os
import select
from collections import deque
from collections.abc import Callable, Collection
from time import monotonic_ns
from typing import Any
from weakref import WeakValueDictionary

from bus import shm
from bus.base.descriptor import Descriptor
from bus.logger import get_logger
from bus.process import guarded
from bus.shm import is_available, segments

SLOTS = 1020
"""Most matches of one process by shared memory; further ones use the socket."""

_SPIN_NS = 5_000
_POLL_NS = 20_000

_log = get_logger("bus")


class ReaderProcess:
    """A process that reads rings of this one, and its doorbell. `is_here`: it is this event loop itself."""

    __slots__ = ("__weakref__", "bell", "doorbell", "is_here", "pid")

    def __init__(self, segment: Descriptor, doorbell: Descriptor, pid: int, *, is_here: bool) -> None:
        self.is_here = is_here
        self.doorbell = doorbell
        self.pid = pid
        self.bell = shm.native.Bell(segments.map_readers(segment), doorbell.number)

    def is_alive(self) -> bool:
        """Whether the process still runs; True also if that is unknown."""
        try:
            process = Descriptor(os.pidfd_open(self.pid))
        except ProcessLookupError:
            return False
        except OSError:
            return True
        ended = select.poll()
        ended.register(process.number, select.POLLIN)
        return not ended.poll(0)


class ShmContext:
    """The shared memory of one link. Raises OSError if the machine has no memory or descriptors left.

    `on_news(owners)` gets the owners of readers with new samples, and must not raise.
    """

    def __init__(self, on_news: Callable[[Collection[Any]], None]) -> None:
        self.doorbell = segments.make_doorbell()
        self.segment, memory = segments.make_readers(SLOTS)
        self.readers = shm.native.Readers(memory, self.doorbell.number)
        self._loop = asyncio.get_running_loop()
        self._on_news = on_news
        self._waiting: dict[object, Callable[[], None]] = {}
        # Longest free first: a publisher may still have a gate on a slot that was just freed.
        self._slots = deque(range(SLOTS))
        self._pinned_slots: list[int] = []
        self._processes: WeakValueDictionary[tuple[int, int], ReaderProcess] = WeakValueDictionary()
        self._doorbells: WeakValueDictionary[str, Descriptor] = WeakValueDictionary()
        self._polls: dict[object, int] = {}
        self._poll_ns = 0
        self._poll_until_ns = 0
        self._is_polling = False
        self._is_poll_due = False
        self._is_closed = False
        # On a loop that threads share, the thread that waits for the samples continues before the rest is
        # done.
        guarded_loop = guarded(self._loop)
        self._deferred = None if guarded_loop is None else guarded_loop.deferred
        self._poll_all = self._rung if self._deferred is None else self._rung_among_threads
        self._loop.add_reader(self.doorbell.number, self._poll_all)
        self.readers.sleep()

    @classmethod
    def make(cls, on_news: Callable[[Collection[Any]], None]) -> "ShmContext | None":
        """Make the context of a link. None if memory may not or can't be shared: then all use the socket."""
        if not is_available():
            return None
        try:
            return cls(on_news)
        except OSError as error:
            _log.warning(f"everything goes by socket: no shared memory: {error.strerror}")
            return None

    def close(self) -> None:
        """Stop listening to the doorbell. Pinned records stay readable."""
        if not self._is_closed:
            self._is_closed = True
            self.readers.close()
            self._loop.remove_reader(self.doorbell.number)
            self._waiting.clear()
            self.doorbell.close()
            self.segment.close()

    def abandon(self) -> None:
        """End in the child of a fork, without touching the event loop or anything else of the parent."""
        self._is_closed = True
        self.readers.close()
        self._waiting.clear()

    # --- the other side

    def reader_process(self, segment: Descriptor, doorbell: Descriptor, pid: int) -> ReaderProcess:
        """The process with this readers' segment; one object for all its matches.

        Raises OSError or ValueError with the fault of the descriptors.
        """
        key = segments.identity(segment)
        process = self._processes.get(key)
        if process is None:
            is_here = key == segments.identity(self.segment)
            process = self._processes[key] = ReaderProcess(segment, doorbell, pid, is_here=is_here)
        return process

    def writer_doorbell(self, doorbell: Descriptor) -> Descriptor:
        """One descriptor for all received descriptors of the same doorbell."""
        with open(f"/proc/self/fdinfo/{doorbell.number}") as file:  # noqa: PTH123
            info = file.read()
        key = next((line for line in info.splitlines() if line.startswith("eventfd-id")), "")
        return self._doorbells.setdefault(key, doorbell) if key else doorbell

    # --- slots

    def allot_slot(self) -> int | None:
        """A slot of the readers' segment; None if all are in use."""
        if not self._slots:
            self._slots += [slot for slot in self._pinned_slots if self.readers.is_free(slot)]
            self._pinned_slots = [slot for slot in self._pinned_slots if slot not in self._slots]
        return self._slots.popleft() if self._slots else None

    def give_back(self, slot: int) -> None:
        """Free the slot of a match that is gone.

        While views of messages pin records, it is not used again.
        """
        (self._slots if self.readers.is_free(slot) else self._pinned_slots).append(slot)

    # --- waking up

    def wait_for_room(self, writer: object, look: Callable[[], None]) -> None:
        """Call `look` at each ring of the doorbell, until `stop_waiting`."""
        self._waiting[writer] = look
        self.readers.has_writers = True

    def wake_waiting(self, writer: object) -> None:
        """Wake a writer that has room without a notification: its ring grew, or a reader left."""
        if writer in self._waiting:
            self._loop.call_soon(self._waiting[writer])

    def stop_waiting(self, writer: object) -> None:
        self._waiting.pop(writer, None)
        self.readers.has_writers = bool(self._waiting)

    def poll_soon(self) -> None:
        """Check all new rings once: samples written before they were attached rang no doorbell."""
        if not self._is_poll_due:
            self._is_poll_due = True
            self._loop.call_soon(self._poll_added)

    def poll(self, owner: object, time_ns: int) -> None:
        """For `owner`, poll without sleeping for up to `time_ns` after each message; 0: stop that."""
        self._polls[owner] = time_ns
        if not time_ns:
            del self._polls[owner]
        self._poll_ns = max(self._polls.values(), default=0)
        if self._poll_ns:
            self._keep_polling()

    def _poll_added(self) -> None:
        self._is_poll_due = False
        self._poll_all()

    def _rung(self) -> None:
        # There are few steps from here to the callback, because each step is slow right after a sleep.
        owners = self.readers.deliver(not self._poll_ns)
        if owners is not None or self._waiting:
            try:
                self._on_news(owners or ())
            finally:  # also if a callback raises an error that is no Exception
                self._turn(True, 0)

    def _rung_among_threads(self) -> None:
        if not self._is_closed:
            owners = self.readers.deliver(False)
            if owners:
                self._on_news(owners)
            assert self._deferred is not None
            self._deferred.append((self._turn, (bool(owners), 0)))

    def _turn(self, has_news: bool, spin_ns: int) -> None:
        """After a delivery: do the rest, then sleep."""
        if self._waiting:
            for look in tuple(self._waiting.values()):
                try:
                    look()
                except Exception as error:  # the other writers must be woken, too
                    message = "looking for room"
                    self._loop.call_exception_handler({"message": message, "exception": error})
        if self._poll_ns and has_news:
            self._keep_polling()
        elif not self._is_closed and (owners := self.readers.sleep(spin_ns)):
            # More samples have come meanwhile. Other callbacks have their turn first. While samples come, a
            # short poll instead of a sleep saves the writers most of their system calls.
            self._loop.call_soon(self._turn_on, owners)

    def _turn_on(self, owners: list[Any]) -> None:
        if not self._is_closed:
            self._on_news(owners)
            self._turn(True, _SPIN_NS)

    def _keep_polling(self) -> None:
        """Continue busy polling, from this message on."""
        self._poll_until_ns = monotonic_ns() + self._poll_ns
        if not self._is_polling:
            self._is_polling = True
            self._loop.call_soon(self._poll_briefly)

    def _poll_briefly(self) -> None:
        """Poll for a short time only: the event loop needs its turns."""
        self._is_polling = False
        if self._is_closed:
            return
        owners = self.readers.look(_POLL_NS)
        if owners:
            self._on_news(owners)
        if owners is not None or monotonic_ns() > self._poll_until_ns:
            self._turn(owners is not None, 0)
        else:
            self._is_polling = True
            self._loop.call_soon(self._poll_briefly)


def say_why_slow() -> None:
    """Warn, once in a process, that messages use the socket route, unless the user has chosen it."""
    if not shm.turned_off_by() and (advice := shm.advice()):
        _log.warning(f"messages go by socket, not by shared memory: {shm.why_not()}; {advice}", once=True)
