"""The frames queued for one connection, and their order.

Control frames go first, in their order. Then the ready queues of runs have turns, and one flooded queue does
not delay the others. A control frame with descriptors keeps its place but is sent by a separate call, because
the kernel binds descriptors to the bytes of one call. Pure: it returns buffers and never sends.
"""

from collections import deque

from bus.base.descriptor import Descriptor
from bus.wire.runs import Account, Buffer, RunQueue

TAKE_BYTES = 256 << 10
_TURN_BYTES = 64 << 10
MAX_BUFFERS = 512  # sendmsg takes 1,024 at most


class Outbox:
    """Control frames and ready queues of one connection.

    Only the bytes of control frames are charged to `account`, so it counts the waiting ones.
    """

    __slots__ = ("account", "control", "ready")

    def __init__(self, account: Account | None = None) -> None:
        self.account = account or Account(0)
        self.control: deque[bytes | tuple[bytes, tuple[Descriptor, ...]]] = deque()
        self.ready: deque[RunQueue] = deque()

    def put(self, frame: bytes, descriptors: tuple[Descriptor, ...] = ()) -> None:
        """Queue a control frame and its descriptors.

        The caller may drop the descriptors but not close them: a closed one could not be sent.
        """
        self.control.append((frame, descriptors) if descriptors else frame)
        self.account.charge(len(frame))

    def make_ready(self, queue: RunQueue) -> None:
        """Give turns to `queue`, which has runs to send, until it is empty."""
        if not queue.is_ready:
            queue.is_ready = True
            self.ready.append(queue)

    def take(self) -> tuple[list[Buffer], int, tuple[Descriptor, ...]]:
        """Buffers to send now, their size, about TAKE_BYTES, and their descriptors.

        Empty if nothing waits.
        """
        buffers: list[Buffer] = []
        size = 0
        control = self.control
        while control and size < TAKE_BYTES and len(buffers) < MAX_BUFFERS:
            frame = control.popleft()
            if isinstance(frame, tuple):
                if buffers:
                    control.appendleft(frame)
                    break
                frame, descriptors = frame
                self.account.charge(-len(frame))
                return [frame], len(frame), descriptors
            size += len(frame)
            buffers.append(frame)
        if size:
            self.account.charge(-size)
        if control:
            return buffers, size, ()
        ready = self.ready
        while ready and size < TAKE_BYTES and len(buffers) < MAX_BUFFERS:
            queue = ready[0]
            turn_end = size + _TURN_BYTES
            while queue.runs and size < turn_end and len(buffers) < MAX_BUFFERS:
                for buffer in queue.pop_frame():
                    buffers.append(buffer)
                    size += len(buffer)
            ready.popleft()
            if queue.runs:
                ready.append(queue)
            else:
                queue.is_ready = False
        return buffers, size, ()

    @property
    def samples(self) -> int:
        """The number of waiting samples."""
        return sum(queue.count for queue in self.ready)

    def clear_control(self) -> None:
        """Drop the control frames, and the references to their descriptors."""
        self.control.clear()
        self.account.charge(-self.account.used)

    def __bool__(self) -> bool:
        return bool(self.control or self.ready)
