"""A publisher's way through the broker over a list only: samples put in, and the runs that come out.

way = Way(KEEP_ALL, window=4)
way.match()
way.put_apart(2)
assert way.left() == [[1], [2]]
"""

from bus.delivery.socket_sender import SocketSender
from bus.delivery.thread_queue import ThreadQueue
from bus.msg.std_msgs import String
from bus.qos import QoSProfile
from bus.types.support import type_support
from bus.wire import messages as m
from bus.wire.layout import MAX_MESSAGE_BYTES
from bus.wire.runs import Run
from list_port import ListPort, Owner

KEEP_ALL = QoSProfile(history="keep_all")
OTHER = 7
GID = b"g" * 16


class Way:
    """A sender that a broker knows, and its output."""

    def __init__(self, qos: QoSProfile, *, window: int = 4) -> None:
        self.port = ListPort()
        self.owner = Owner(qos, type_support(String))
        self.window = window
        self.sender = SocketSender(self.port, self.owner, ThreadQueue(1 << 20))  # type: ignore[arg-type]
        self.owner.on_hand_over = self.sender.hand_over
        self.number = 0
        self.declare()

    def declare(self, number: int = 1) -> None:
        """Let a broker know the publisher, by that number."""
        self.port.is_away, self.owner.id = False, number
        qos = self.owner.qos
        self.sender.declared(
            m.Created(
                request=1,
                id=number,
                depth=0 if qos.is_lossless else qos.depth,
                max_message_bytes=MAX_MESSAGE_BYTES,
                window_samples=self.window,
                window_bytes=1000,
            )
        )
        self.port.flush()

    def lose(self) -> None:
        self.port.lose()
        self.owner.id = 0
        self.sender.disconnected()

    def match(self, qos: QoSProfile | None = None, gid: bytes = GID, other: int = OTHER) -> None:
        self.sender.recipients.matched(other, gid, qos or self.owner.qos, by_socket=True)
        self.port.flush()

    def put(self, count: int = 1, size: int = 0) -> None:
        """Put `count` samples; each must be taken if there is room."""
        for _ in range(count):
            self.number += 1
            payload = b"%d" % self.number + b"x" * size
            stamp_ns = self.port.now_ns()
            if not self.sender.run.add(payload, stamp_ns):
                self.sender.put(payload, stamp_ns)

    def put_apart(self, count: int) -> None:
        """Put samples one by one, each long after the previous one."""
        for _ in range(count):
            self.port.advance(0.001)
            self.put()

    def left(self) -> list[list[int]]:
        """The runs that have left since, as the numbers of their samples."""
        return [numbers(run) for run in self.port.runs()]


def numbers(run: Run) -> list[int]:
    found = [int(bytes(payload).rstrip(b"x")) for payload, _ in run.records()]
    assert found == [*range(run.first_seq, run.first_seq + run.count)]
    return found
