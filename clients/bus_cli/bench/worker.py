"""One publisher or subscriber of a measurement, as a process: `python -m bus_cli.bench.worker TASK`.

Reads and writes the words of `bus_cli.bench.task` on stdin and stdout. Ends when its stdin ends.
"""

import asyncio
import contextlib
import os
import sys
from collections.abc import Callable, Coroutine
from time import monotonic_ns, sleep
from typing import Any

from msgspec import json

from bus import shm
from bus.errors import BusError, PayloadTooLarge
from bus.node import Node
from bus.publisher import Publisher
from bus.runner import run
from bus.subscription import Subscription
from bus_cli.bench.payload import HEAD, Payload, read_stamps
from bus_cli.bench.task import Event, Go, Progress, Ready, Sent, Settle, Settled, Stop, Task, Trouble, Word
from bus_cli.output import CommandError

_LOOP_NS = 2_000_000
"""The loop's timers have whole milliseconds, so the process sleeps the rest of a wait itself."""
_PROGRESS_S = 0.2
_STAMP_NS = 1_000_000
"""Shortest time between stamped messages in a flood: stamps cost more than a small message."""
_MOST_IN_TURN = 512
_TURN_BYTES = 1 << 20
"""In a flood, the publisher yields to the event loop and reads the clock after this many bytes."""
_LOOK_S = 0.01
_QUIET_S = 3.0
"""A subscriber that has received nothing for this time expects no more messages."""


class Verb:
    """The process that started this one. It receives events and sends words."""

    def __init__(self) -> None:
        self.stopped = asyncio.Event()
        self._words: asyncio.Queue[Go | Settle] = asyncio.Queue()

    def send(self, event: Event) -> None:
        sys.stdout.buffer.write(json.encode(event) + b"\n")
        sys.stdout.buffer.flush()

    async def word(self) -> Go | Settle:
        """The next word. Exception: Stop sets `stopped` at its arrival and is not returned."""
        return await self._words.get()

    async def listen(self) -> None:
        """Read its words until stdin ends."""
        reader = asyncio.StreamReader()
        transport, _ = await asyncio.get_running_loop().connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(0, "rb", buffering=0)
        )
        with contextlib.closing(transport):
            while line := await reader.readline():
                word = json.decode(line, type=Word)
                if isinstance(word, Stop):
                    self.stopped.set()
                else:
                    self._words.put_nowait(word)


class Talker:
    """Publishes the messages of a measurement. Its publisher is matched with all subscribers."""

    def __init__(self, verb: Verb, task: Task, publisher: Publisher[Any]) -> None:
        self._verb = verb
        self._task = task
        self._publisher = publisher
        self._payload = Payload(task.type_name, task.size)
        self._count = 0

    async def work(self) -> None:
        """Execute words for ever."""
        routes = sorted({match.route for match in self._publisher.matches})
        self._verb.send(Ready(routes=tuple(routes), why_socket=shm.why_not()))
        while isinstance(go := await self._verb.word(), Go):
            self._count = 0
            telling = asyncio.create_task(self._send_progress())
            try:
                begin_ns = monotonic_ns()
                await (self._pace(go) if self._task.rate else self._flood(go))
                await self._publisher.flush()
                end_ns = monotonic_ns()
            finally:
                telling.cancel()
            self._verb.send(Sent(count=self._count, begin_ns=begin_ns, end_ns=end_ns))

    async def _pace(self, go: Go) -> None:
        """Publish by a fixed schedule: overdue messages are sent at once, and no message is skipped."""
        period_ns = 1e9 / self._task.rate
        start_ns = monotonic_ns() + min(period_ns, _LOOP_NS)
        for number in range(go.count):
            due_ns = int(start_ns + number * period_ns)
            await self._sleep_until(due_ns)
            if self._verb.stopped.is_set():
                return
            await self._publish(self._payload.stamped(due_ns, monotonic_ns()))
            await asyncio.sleep(0)

    async def _sleep_until(self, due_ns: int) -> None:
        early_s = (due_ns - monotonic_ns() - _LOOP_NS) / 1e9
        if early_s > _LOOP_NS / 1e9:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(early_s):
                    await self._verb.stopped.wait()
                    return
        rest_ns = due_ns - monotonic_ns()
        if rest_ns > 0:
            sleep(rest_ns / 1e9)  # noqa: ASYNC251

    async def _flood(self, go: Go) -> None:
        """Publish at full speed; stamp the last message, and another one from time to time."""
        publish, plain = self._publisher.publish, self._payload.plain
        turn = max(1, min(_MOST_IN_TURN, _TURN_BYTES // self._task.size))
        end_ns = monotonic_ns() + int(go.seconds * 1e9)
        stamp_ns = 0
        while not self._verb.stopped.is_set() and self._count + 1 < (go.count or sys.maxsize):
            now_ns = monotonic_ns()
            if not go.count and now_ns >= end_ns:
                break
            if now_ns >= stamp_ns:
                stamp_ns = now_ns + _STAMP_NS
                await self._publish(self._payload.stamped(now_ns, now_ns))
            number = min(turn, go.count - self._count - 1) if go.count else turn
            for _ in range(number):
                message = plain()
                if not publish(message):
                    await self._publisher.send(message)
            self._count += number
            await asyncio.sleep(0)
        now_ns = monotonic_ns()
        await self._publish(self._payload.stamped(now_ns, now_ns))

    async def _publish(self, message: Any) -> None:
        if not self._publisher.publish(message):
            await self._publisher.send(message)
        self._count += 1

    async def _send_progress(self) -> None:
        while True:
            await asyncio.sleep(_PROGRESS_S)
            self._verb.send(Progress(count=self._count))


class Listener:
    """Counts the messages of a subscription, and keeps the ages of the stamped ones."""

    def __init__(self, verb: Verb, task: Task) -> None:
        payload = Payload(task.type_name, task.size)
        self._verb = verb
        self._get, self._mark = payload.get, payload.mark
        self._heads: list[Any] = []
        self._came_ns: list[int] = []
        self._last_ns = 0
        self._delivered = 0
        self._dropped: dict[str, int] = {}
        self.take: Callable[[Any], None] = self._take_all
        """The callback."""
        if not task.rate:
            self.take = self._make_counter() if task.qos.is_lossless else self._take

    def _take_all(self, message: Any) -> None:
        """Callback if all messages are stamped."""
        self._came_ns.append(monotonic_ns())
        self._heads.append(self._get(message)[:HEAD])

    def _make_counter(self) -> Callable[[Any], None]:
        """Make the callback for floods: few messages are stamped, among them the last.

        It is a closure because each access to self costs time.
        """
        get, mark, take_stamped = self._get, self._mark, self._take_all

        def take(message: Any) -> None:
            if get(message)[0] == mark:
                take_stamped(message)

        return take

    def _take(self, message: Any) -> None:
        """Callback for floods that may lose their last message."""
        self._last_ns = monotonic_ns()
        if self._get(message)[0] == self._mark:
            self._take_all(message)

    async def work(self, subscription: Subscription[Any]) -> None:
        """Execute words for ever."""
        self._verb.send(Ready())
        while isinstance(settle := await self._verb.word(), Settle):
            await self._settle(subscription, settle.published)
            self._verb.send(self._report(subscription))

    async def _settle(self, subscription: Subscription[Any], published: int) -> None:
        """Wait until `published` messages have arrived or are known to be lost, or until no more arrive."""
        known, quiet_s = -1, 0.0
        while quiet_s < _QUIET_S:
            totals = subscription.statistics()
            now_known = totals.delivered + sum(totals.dropped.values())
            if now_known >= published:
                return
            quiet_s = quiet_s + _LOOK_S if now_known == known else 0.0
            known = now_known
            await asyncio.sleep(_LOOK_S)

    def _report(self, subscription: Subscription[Any]) -> Settled:
        totals = subscription.statistics()
        stamps = list(map(read_stamps, self._heads))
        settled = Settled(
            delivered=totals.delivered - self._delivered,
            dropped={
                reason: count - self._dropped.get(reason, 0)
                for reason, count in totals.dropped.items()
                if count > self._dropped.get(reason, 0)
            },
            last_ns=max(self._last_ns, *self._came_ns[-1:], 0),
            sent_ns=[stamp.sent_ns for stamp in stamps],
            late_ns=[stamp.sent_ns - stamp.due_ns for stamp in stamps],
            age_ns=[now - stamp.sent_ns for now, stamp in zip(self._came_ns, stamps, strict=True)],
        )
        self._delivered, self._dropped, self._last_ns = totals.delivered, totals.dropped, 0
        self._heads.clear()
        self._came_ns.clear()
        return settled


async def _publish(verb: Verb, task: Task, node: Node) -> None:
    message_type = Payload(task.type_name, task.size).type
    publisher = await node.create_publisher(message_type, task.topic, task.qos)
    await publisher.wait_for_subscriptions(task.subscribers)
    await Talker(verb, task, publisher).work()


async def _subscribe(verb: Verb, task: Task, node: Node) -> None:
    listener = Listener(verb, task)
    message_type = Payload(task.type_name, task.size).type
    subscription = await node.create_subscription(message_type, task.topic, task.qos, listener.take)
    await subscription.wait_for_publishers(task.publishers)
    await listener.work(subscription)


async def _work(verb: Verb, task: Task) -> None:
    roles = {"publisher": _publish, "subscriber": _subscribe}
    try:
        async with Node(
            f"_bench_{task.role}_{os.getpid()}", arguments=(), socket=task.socket, rosout=False
        ) as node:
            await roles[task.role](verb, task, node)
    except PayloadTooLarge as error:
        verb.send(
            Trouble(
                f"--size {task.size}: that is a message of {error.size_bytes} B, and busd's limit is "
                f"{error.limit_bytes} B (message_bytes in busd.toml)"
            )
        )
    except (BusError, CommandError) as error:
        verb.send(Trouble(str(error)))


async def _until_the_end(task: Task) -> None:
    verb = Verb()
    working = asyncio.create_task(_work(verb, task))
    listening = asyncio.create_task(verb.listen())
    try:
        await asyncio.wait({working, listening}, return_when=asyncio.FIRST_COMPLETED)
        if working.done():
            working.result()  # raises if this worker has a bug
            await listening
    finally:
        await _cancel(working, listening)


async def _cancel(*tasks: "asyncio.Task[None]") -> None:
    for one in tasks:
        one.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def main() -> None:
    """The program."""
    work: Coroutine[Any, Any, None] = _until_the_end(json.decode(sys.argv[1], type=Task))
    with contextlib.suppress(BrokenPipeError):  # the parent process is gone
        run(work)


if __name__ == "__main__":
    main()
