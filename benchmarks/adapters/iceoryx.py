"""iceoryx2 by its Python binding: memory is loaned, filled by the publisher, read in place by the subscriber.

The subscriber blocks in a listener, which the publisher notifies after each sample (`take_by` "event"), or
asks again and again and uses a whole CPU for that ("polling"). A payload of up to `HEAD` bytes ends as a
`str`, as everywhere; of a longer one only the head is looked at. In a flood the publisher waits where the
subscriber's buffer is full.
"""

import ctypes
import os
import sys
from pathlib import Path
from typing import Any

import iceoryx2  # type: ignore[import-untyped]
import msgspec

from benchmarks.adapters import roles
from benchmarks.work import HEAD, Work, text_of
from benchmarks.worker import Parent, options, run

_BUFFERED = 64


class _Services:
    """The node and its two services; both ends ask for the same."""

    def __init__(self, work: Work) -> None:
        iceoryx2.set_log_level(iceoryx2.LogLevel.Error)
        self.node: Any = (
            iceoryx2.NodeBuilder.new()
            .signal_handling_mode(iceoryx2.SignalHandlingMode.Disabled)
            .create(iceoryx2.ServiceType.Ipc)
        )
        name = iceoryx2.ServiceName.new(Path(os.environ["BENCH_FOLDER"]).name)
        self.samples: Any = (
            self.node.service_builder(name)
            .publish_subscribe(ctypes.c_uint8 * work.size)
            .subscriber_max_buffer_size(_BUFFERED)
            .enable_safe_overflow(False)
            .open_or_create()
        )
        self.events: Any = self.node.service_builder(name).event().open_or_create()


async def publisher(parent: Parent) -> None:
    work: Work = options(Work)
    services = _Services(work)
    port: Any = (
        services.samples.publisher_builder()
        .backpressure_strategy(iceoryx2.BackpressureStrategy.RetryUntilDelivered)
        .create()
    )
    notifier: Any = services.events.notifier_builder().create()
    loan, notify, move = port.loan_uninit, notifier.notify, ctypes.memmove
    body = text_of(work.size).encode() if work.size > HEAD else b""
    is_notified = work.take_by == "event"

    def send(head: str) -> None:
        sample = loan()
        place = sample.payload_ptr
        if body:
            move(place, body, len(body))
        move(place, head.encode(), len(head))
        sample.assume_init().send()
        if is_notified:
            notify()

    await roles.publish(parent, msgspec.structs.replace(work, size=min(work.size, HEAD)), send)


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    services = _Services(work)
    taker = roles.Taker(parent, work)
    port: Any = services.samples.subscriber_builder().create()
    listener: Any = services.events.listener_builder().create()
    receive, wait, take = port.receive, listener.blocking_wait, taker.take
    is_waiting, size, string_at = work.take_by == "event", min(work.size, HEAD), ctypes.string_at
    parent.tell("ready")
    while not taker.is_done:
        sample = receive()
        if sample is not None:
            take(string_at(sample.payload_ptr, size).decode())
        elif is_waiting:
            wait()
    await taker.finish()


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
