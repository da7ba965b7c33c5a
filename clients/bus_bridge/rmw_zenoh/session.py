"""The zenoh session of a bridge to ROS 2: everything used of the package `zenoh` besides
`bus_bridge.zenoh.session`.

It has the settings of rmw_zenoh: a peer with timestamps. It finds other peers through its router by gossip.
With `router` it is a client of that router instead.
"""

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, NamedTuple

import zenoh
import zenoh.ext
from zenoh.handlers import Callback

from bus_bridge.engine import Priority
from bus_bridge.errors import BridgeError
from bus_bridge.zenoh.options import ZenohOptions
from bus_bridge.zenoh.session import PRIORITIES, Declared, Session, Source

__all__ = ["Asking", "Question", "RosOutlet", "RosSession"]

_LOOPBACK: Final = "tcp/localhost:0"
_MOST_BYTES: Final = 64 << 20
"""The largest message that is accepted, in all its fragments."""
_QUESTION_BYTES: Final = 2048
"""The cost of a request besides its payload and its attachment."""
_FOREVER_S: Final = 10.0 * 365 * 86_400
"""ROS 2's clients wait as long as they want; the end of a server ends its calls."""

_MOST_LETTERS: Final = 300
"""Bytes of a server's error that the user sees."""
_WINDOW_BYTES: Final = 4 << 20
"""Messages of all reliable publishers that wait for room in a link."""

Push = Callable[[bytes, bytes], None]


class Question(NamedTuple):
    """A request of a far client. Answer or drop it once."""

    query: Any
    payload: bytes
    attachment: bytes

    def reply(self, key: str, payload: bytes, attachment: bytes) -> None:
        with suppress(zenoh.ZError):  # the other side has gone
            self.query.reply(key, payload, attachment=attachment)
        self.query.drop()

    def drop(self) -> None:
        """Send no answer."""
        self.query.drop()


class RosOutlet(Declared):
    """A publisher in zenoh. `on_change` is called on the loop if `is_wanted` has changed, or a reliable
    publisher has room again.

    `kept`: the number of messages for late joiners; None if there are none. `waits`: messages wait in a
    thread until the link has room, instead of being dropped by zenoh.
    """

    def __init__(
        self,
        session: "RosSession",
        key: str,
        on_change: Callable[[], None],
        kept: int | None,
        priority: Priority = "data",
        *,
        waits: bool,
    ) -> None:
        self.is_wanted = False
        self.waits = waits
        self._ros_session = session
        self._kept = kept
        self._on_change = on_change
        self._listener: Any = None
        super().__init__(session, lambda: session.declare_ros_publisher(key, kept, priority, waits=waits))

    def put(self, payload: bytes, attachment: bytes) -> bool:
        """Send a message; False if there is no room."""
        publisher = self._entity
        if self.waits:
            return publisher is not None and self._ros_session.sending.add(
                lambda: publisher.put(payload, attachment=attachment), len(payload), self._on_change
            )
        if publisher is not None:
            with suppress(zenoh.ZError):  # the session is closed
                publisher.put(payload, attachment=attachment)
        return True

    def undeclare(self) -> None:
        """As Declared, after all messages."""
        if self.waits and self._entity is not None:
            self._ros_session.sending.add(super().undeclare, 0)
        else:
            super().undeclare()

    def _make(self) -> None:
        super()._make()
        publisher = self._entity
        if publisher is not None and self._kept is None:
            self._listener = publisher.declare_matching_listener(
                Callback(lambda status: self._session.call(self._look), indirect=False)
            )
        self._session.call(self._look)

    def _look(self) -> None:
        """Update `is_wanted`: the status now counts, since news may be late."""
        publisher = self._entity
        if publisher is None or self._is_gone:
            return
        is_wanted = self._kept is not None or bool(publisher.matching_status.matching)
        if is_wanted != self.is_wanted:
            self.is_wanted = is_wanted
            self._on_change()


class Asking(Declared):
    """A client in zenoh."""

    def __init__(self, session: "RosSession", key: str) -> None:
        self._ros_session = session
        super().__init__(session, lambda: session.declare_querier(key))

    @property
    def is_matched(self) -> bool:
        """Whether a server is there."""
        querier = self._entity
        return querier is not None and bool(querier.matching_status.matching)

    def ask(
        self,
        payload: bytes,
        attachment: bytes,
        on_answer: Callable[[bytes, bytes, str, str], None],
        on_end: Callable[[], None],
    ) -> Callable[[], None]:
        """Ask all servers. `on_answer` is called on the loop with the payload and the attachment of each
        answer, an error text, and the zenoh id of the server. `on_end` is called after all of them. The
        result gives the question up."""
        token = zenoh.CancellationToken()
        call = self._session.call

        def reply(answer: Any) -> None:
            replier = answer.replier_id
            session = "" if replier is None else str(replier.zid)
            if (sample := answer.ok) is not None:
                call(on_answer, sample.payload.to_bytes(), _bytes_of(sample.attachment), "", session)
            else:
                call(on_answer, b"", b"", _text_of(answer.err.payload.to_bytes()), session)

        def ask() -> None:
            try:
                self._entity.get(
                    Callback(reply, lambda: call(on_end), indirect=False),
                    payload=payload,
                    attachment=attachment,
                    cancellation_token=token,
                )
            except (zenoh.ZError, AttributeError):  # the session or the client is closed
                call(on_end)

        self._ros_session.sending.add(ask, len(payload))
        return lambda: self._session.do(token.cancel)


class _Sending:
    """A thread that sends messages of reliable publishers, requests and answers. It waits for room in a link.

    `on_room` is called on the loop when there is room again.
    """

    def __init__(self, session: "RosSession") -> None:
        self._session = session
        self._news = threading.Condition()
        self._waiting: deque[tuple[Callable[[], object], int]] = deque()
        self._bytes = 0
        self._blocked: dict[Callable[[], None], None] = {}
        self._is_closed = False

    def open(self) -> None:
        """Start. Raises RuntimeError if there is no thread for it."""
        threading.Thread(target=self._work, name="bus_bridge rmw_zenoh", daemon=True).start()

    def add(self, job: Callable[[], object], size: int, on_room: Callable[[], None] | None = None) -> bool:
        """Run `job` in the thread, after all earlier ones. Its message has `size` bytes. False without
        room."""
        with self._news:
            if on_room is not None and self._waiting and self._bytes + size > _WINDOW_BYTES:
                self._blocked[on_room] = None
                return False
            self._waiting.append((job, size))
            self._bytes += size
            self._news.notify()
        return True

    def close(self) -> None:
        with self._news:
            self._is_closed = True
            self._news.notify()

    def _work(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._waiting or self._is_closed)
                if self._is_closed:
                    return
                job, size = self._waiting[0]
            try:
                job()
            except zenoh.ZError:
                pass  # the publisher or the session is closed
            except Exception as error:
                self._session.report(error)
            with self._news:
                self._waiting.popleft()
                self._bytes -= size
                blocked = list(self._blocked) if self._bytes <= _WINDOW_BYTES // 2 else []
                for one in blocked:
                    del self._blocked[one]
            for one in blocked:
                self._session.call(one)


class RosSession(Session):
    """As Session, with the declarations of rmw_zenoh."""

    def __init__(self, options: ZenohOptions, on_fault: Callable[[Exception], None]) -> None:
        settings: dict[str, object] = {
            "timestamping/enabled": True,
            "transport/link/rx/max_message_size": _MOST_BYTES,
        }
        if not options.router:
            settings["scouting/gossip/enabled"] = True
            settings["listen/endpoints"] = list(options.listen) or [_LOOPBACK]
        super().__init__(options, on_fault, settings)
        self.sending = _Sending(self)
        """The thread that waits for room in links."""

    async def open(self) -> None:
        """As Session."""
        await super().open()
        try:
            self.sending.open()
        except RuntimeError as error:
            await super().close()
            raise BridgeError(f"zenoh can't start a second thread: {error}") from None

    async def close(self) -> None:
        """As Session. Messages that wait for room are lost."""
        self.sending.close()
        await super().close()

    def report(self, error: Exception) -> None:
        """Report a bug in the bridge; may be used in any thread."""
        self.call(self._on_fault, error)

    def hear(self, key: str, push: Push, *, with_history: bool) -> Declared:
        """Subscribe: zenoh's thread calls `push` with each message's payload and attachment.

        `with_history`: also with the messages that publishers keep.
        """

        def see(sample: Any) -> None:
            push(sample.payload.to_bytes(), _bytes_of(sample.attachment))

        def declare() -> Any:
            callback = Callback(see, indirect=False)
            if not with_history:
                return self._zenoh.declare_subscriber(key, callback, allowed_origin=zenoh.Locality.REMOTE)
            return zenoh.ext.declare_advanced_subscriber(
                self._zenoh,
                key,
                callback,
                allowed_origin=zenoh.Locality.REMOTE,
                history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
            )

        return Declared(self, declare)

    def serve(self, key: str, source: Source[Question]) -> Declared:
        """Answer requests: `source` gets each of them, with its size in bytes."""

        def see(query: Any) -> None:
            payload = b"" if query.payload is None else query.payload.to_bytes()
            question = Question(query, payload, _bytes_of(query.attachment))
            source.push(question, len(payload) + len(question.attachment) + _QUESTION_BYTES)

        return Declared(
            self,
            lambda: self._zenoh.declare_queryable(
                key,
                Callback(see, indirect=False),
                complete=True,
                allowed_origin=zenoh.Locality.REMOTE,
            ),
        )

    # --- in the thread for declarations

    def declare_ros_publisher(self, key: str, kept: int | None, priority: Priority, *, waits: bool) -> Any:
        control = zenoh.CongestionControl.BLOCK if waits else zenoh.CongestionControl.DROP
        if kept is None:
            return self._zenoh.declare_publisher(
                key,
                congestion_control=control,
                priority=PRIORITIES[priority],
                express=True,
                allowed_destination=zenoh.Locality.REMOTE,
            )
        return zenoh.ext.declare_advanced_publisher(
            self._zenoh,
            key,
            congestion_control=control,
            priority=PRIORITIES[priority],
            express=True,
            allowed_destination=zenoh.Locality.REMOTE,
            cache=zenoh.ext.CacheConfig(kept),
            publisher_detection=True,
        )

    def declare_querier(self, key: str) -> Any:
        return self._zenoh.declare_querier(
            key,
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=_FOREVER_S,
            allowed_destination=zenoh.Locality.REMOTE,
        )


def _bytes_of(attachment: Any) -> bytes:
    return b"" if attachment is None else attachment.to_bytes()


def _text_of(error: bytes) -> str:
    """The error of a server, for a terminal."""
    text = error[:_MOST_LETTERS].decode("utf-8", "replace")
    return "".join(one if one.isprintable() else "?" for one in text) or "the server reports an error"
