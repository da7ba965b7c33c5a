"""A port for `bus.delivery` over a list and a clock that a test sets by hand: no event loop, no socket.

    port = ListPort()
    sender = SocketSender(port, Owner(QoSProfile()), ThreadQueue(1 << 20))
    sender.put(b"one", port.now_ns())
    assert [run.first_seq for run in port.runs()] == [1]

Data sent by delivery are in `written`, until the test takes them. The socket takes everything, except while
`is_choked`. Without a broker (`is_away`) nothing is sent. Requested tasks and calls run in `settle`, timers
in `advance`.
"""

from collections import deque
from collections.abc import Callable, Coroutine, Generator
from heapq import heappop, heappush
from itertools import count
from typing import Any

from bus.base.descriptor import Descriptor
from bus.delivery.port import Port, ShmPort
from bus.qos import QoSProfile
from bus.types.support import TypeSupport
from bus.wire import messages as m
from bus.wire.layout import PROTOCOL_VERSION
from bus.wire.outbox import Outbox
from bus.wire.runs import Buffer, Run, RunQueue
from bus.wire.session import Carried, Role, Session
from feeding import feed

SECOND = 1_000_000_000
_MOST_TURNS = 10_000


class Timer:
    def __init__(self, call: Callable[[], object]) -> None:
        self.call = call
        self.is_cancelled = False

    def cancel(self) -> None:
        self.is_cancelled = True


class Clock:
    """A clock that stands still, except for a nanosecond at each read: no two events happen at once."""

    def __init__(self) -> None:
        self.now_ns = 1_000 * SECOND
        self._timers: list[tuple[int, int, Timer]] = []
        self._numbers = count()

    def look(self) -> int:
        self.now_ns += 1
        return self.now_ns

    def at(self, due_ns: int, call: Callable[[], object]) -> Timer:
        timer = Timer(call)
        heappush(self._timers, (due_ns, next(self._numbers), timer))
        return timer

    def forget(self) -> None:
        """Cancel all timers."""
        self._timers.clear()

    def next_ns(self) -> int | None:
        while self._timers and self._timers[0][2].is_cancelled:
            heappop(self._timers)
        return self._timers[0][0] if self._timers else None

    def run_due(self) -> None:
        """Call all timers that are due."""
        while (due_ns := self.next_ns()) is not None and due_ns <= self.now_ns:
            heappop(self._timers)[2].call()

    def advance(self, seconds: float, between: Callable[[], object] = int) -> None:
        """Let time pass, with the timers in order, and calls of `between` before them."""
        end_ns = self.now_ns + round(seconds * SECOND)
        while (due_ns := self.next_ns()) is not None and due_ns <= end_ns:
            self.now_ns = max(self.now_ns, due_ns)
            self.run_due()
            between()
        self.now_ns = max(self.now_ns, end_ns)


class Future:
    """A future for a task."""

    def __init__(self) -> None:
        self.is_done = False
        self.error: BaseException | None = None
        self.on_done: Callable[[], object] = int

    def finish(self, error: BaseException | None = None) -> None:
        if not self.is_done:
            self.is_done, self.error = True, error
            self.on_done()

    def __await__(self) -> Generator["Future", None, None]:
        if not self.is_done:
            yield self
        if self.error is not None:
            raise self.error


class Task:
    """Runs a coroutine that awaits only futures of a ListPort."""

    def __init__(self, soon: Callable[..., object], work: Coroutine[Any, Any, Any]) -> None:
        self.is_done = False
        self.result: Any = None
        self.error: BaseException | None = None
        self._soon = soon
        self._work = work
        soon(self._go_on)

    def cancel(self) -> None:
        self._work.close()
        self.is_done = True

    def _go_on(self) -> None:
        if self.is_done:
            return
        try:
            future: Future = self._work.send(None)
        except StopIteration as end:
            self.is_done, self.result = True, end.value
        except Exception as error:
            self.is_done, self.error = True, error
        else:
            future.on_done = lambda: self._soon(self._go_on)


class Waiters:
    def __init__(self, port: "ListPort") -> None:
        self._port = port
        self._waiting: list[Future] = []

    def __bool__(self) -> bool:
        return bool(self._waiting)

    async def wait(self, timeout_s: float | None = None) -> bool:
        future = Future()
        self._waiting.append(future)
        is_late = False

        def give_up() -> None:
            nonlocal is_late
            is_late = not future.is_done
            future.finish()

        if timeout_s is not None:
            self._port.later(timeout_s, give_up)
        try:
            await future
        finally:
            if future in self._waiting:
                self._waiting.remove(future)
        return not is_late

    def release(self) -> None:
        self._finish(None)

    def fail(self, reason: BaseException) -> None:
        self._finish(reason)

    def _finish(self, error: BaseException | None) -> None:
        waiting, self._waiting = self._waiting, []
        for future in waiting:
            future.finish(error)


class Owner:
    """The part of a publisher or subscription that delivery needs. `id` 0: unknown to the broker."""

    def __init__(self, qos: QoSProfile, support: TypeSupport[Any], number: int = 1) -> None:
        self.id = number
        self.topic_name = "/topic"
        self.qos = qos
        self.support = support
        self.refusal = None
        self.on_hand_over: Callable[[], object] = int

    def hand_over(self) -> None:
        self.on_hand_over()

    def totals(self) -> m.Report:
        raise NotImplementedError


class ListPort:
    """A `bus.delivery.port.Port`."""

    is_shared = False
    is_writing = False
    shm_context: ShmPort | None = None

    def __init__(self, clock: Clock | None = None) -> None:
        self.clock = clock or Clock()
        self.now_ns = self.clock.look
        self.is_mine = True
        """Whether the thread of the test may use the objects here."""
        self.owns_thread: Callable[[], bool] = lambda: self.is_mine
        self.is_away = False
        self.is_choked = False
        self.hears_all = True
        self.last_sent_ns = 0
        self.outbox = Outbox()
        self.written: list[tuple[bytes, tuple[Descriptor, ...]]] = []
        self.reported: list[Any] = []
        self.calls = deque[Callable[[], object]]()
        self.tasks: list[Task] = []
        self._gathered: dict[Any, None] = {}
        self._drains = Waiters(self)
        self._session = Session(Role.BROKER)
        self._session.open(m.Hello(version=PROTOCOL_VERSION))

    # --- for tests

    def run_once(self) -> bool:
        """Make the requested calls; returns whether there were any."""
        for _ in range(number := len(self.calls)):
            self.calls.popleft()()
        return number > 0

    def settle(self) -> None:
        for _ in range(_MOST_TURNS):
            if not self.run_once():
                return
        raise AssertionError("it goes on and on")

    def advance(self, seconds: float) -> None:
        self.clock.advance(seconds, self.settle)
        self.settle()

    def run(self, work: Coroutine[Any, Any, Any]) -> Task:
        """Start `work`, and let it run as far as possible."""
        task = Task(self.soon, work)
        self.settle()
        return task

    def lose(self) -> None:
        """Lose the broker, and all frames that waited for the socket."""
        self.is_away, self.outbox = True, Outbox()

    def unchoke(self) -> None:
        """Let the socket take bytes again."""
        self.is_choked = False
        self.wrote()
        self.flush()

    def sent(self) -> list[Any]:
        """The messages and runs that were sent since the last call."""
        written, self.written = self.written, []
        found = list[Any]()
        for data, descriptors in written:
            if descriptors:
                self._session.descriptors.append(descriptors)
            for item in feed(self._session, data):
                if isinstance(item, Run):
                    item.body = bytes(item.body)  # the buffer is used again
                found.append(item.message if isinstance(item, Carried) else item)
        return found

    def runs(self) -> list[Run]:
        return [item for item in self.sent() if isinstance(item, Run)]

    # --- to the broker

    def write(self, data: bytes, descriptors: tuple[Descriptor, ...] = ()) -> None:
        self.written.append((data, descriptors))

    def send_about(
        self, owner: Any, message: m.Message | bytes, descriptors: tuple[Descriptor, ...] = ()
    ) -> None:
        if owner.id and message and not self.is_away:
            self.outbox.put(message if isinstance(message, bytes) else m.encode_frame(message), descriptors)
            self.flush()

    def send_now(self, frame: Buffer) -> bool:
        if self.is_away or self.is_choked or self.outbox:
            return False
        self.write(bytes(frame))
        return True

    def gather(self, owner: Any) -> None:
        if not self._gathered:
            self.soon(self.hand_over)
        self._gathered[owner] = None

    def hand_over(self) -> None:
        gathered, self._gathered = self._gathered, {}
        for owner in gathered:
            owner.hand_over()
        self.flush()

    def make_ready(self, queue: RunQueue) -> None:
        if not self.is_away:
            self.outbox.make_ready(queue)

    def flush(self) -> None:
        while self.outbox and not (self.is_away or self.is_choked):
            buffers, _, descriptors = self.outbox.take()
            self.write(b"".join(buffers), descriptors)

    def wrote(self) -> None:
        self.soon(self._drains.release)

    async def wait_for_drain(self, queue: RunQueue) -> None:
        while queue.runs:
            await self._drains.wait()

    def report(self, owner: Any) -> None:
        self.reported.append(owner)

    def is_quiet(self) -> bool:
        return self.hears_all

    # --- the event loop

    def soon(self, call: Callable[..., object], *args: Any) -> None:
        self.calls.append(lambda: call(*args))

    soon_threadsafe = soon

    def later(self, delay_s: float, call: Callable[..., object], *args: Any) -> Timer:
        return self.clock.at(self.clock.now_ns + round(delay_s * SECOND), lambda: self.soon(call, *args))

    async def turn(self) -> None:
        future = Future()
        self.soon(future.finish)
        await future

    def waiters(self) -> Waiters:
        return Waiters(self)

    def start(self, work: Coroutine[Any, Any, None], name: str) -> Callable[[], object]:
        task = Task(self.soon, work)
        self.tasks.append(task)
        return task.cancel


def _is_a_port(port: ListPort) -> Port:
    return port
