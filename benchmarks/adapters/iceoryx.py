"""iceoryx2 by its Python binding: a sample is loaned in shared memory, filled, and read there.

With `take_by` "event", the subscriber blocks in a listener, which the publisher notifies after each sample.
With "polling" it polls all the time and uses a whole CPU. The payload ends as a `str`, as in all systems.
With `publish_by` "loan" it is used in place, and only the head of a long payload is read. In a flood the
publisher waits while a subscriber's buffer is full. Version 0.10 does not always wait, although it has the
option for it (RetryUntilDelivered). So the publisher sends a sample again if no subscriber took it.

iceoryx2 keeps a file in /dev/shm and a folder in /tmp, also after the run. They allow its next process to
clean up after a killed one.
"""

import ctypes
import os
import sys
from pathlib import Path
from typing import Any

import iceoryx2
import msgspec

from benchmarks.adapters import roles
from benchmarks.work import HEAD, Work, text_of
from benchmarks.worker import Parent, options, run

_BUFFERED = 1000
_BUFFERED_BYTES = 16 << 20
_LEAST = 4


class _Services:
    """The node and its two services; all ends open the same ones."""

    def __init__(self, work: Work) -> None:
        iceoryx2.set_log_level(iceoryx2.LogLevel.Error)
        self.node: Any = (
            iceoryx2.NodeBuilder.new()
            .signal_handling_mode(iceoryx2.SignalHandlingMode.Disabled)
            .create(iceoryx2.ServiceType.Ipc)
        )
        name = iceoryx2.ServiceName.new(Path(os.environ["BENCH_FOLDER"]).name)
        ends = work.subscribers + 1
        self.samples: Any = (
            self.node.service_builder(name)
            .publish_subscribe(ctypes.c_uint8 * work.size)
            .subscriber_max_buffer_size(max(_LEAST, min(_BUFFERED, _BUFFERED_BYTES // work.size)))
            .max_subscribers(work.subscribers)
            .max_nodes(ends)
            .enable_safe_overflow(False)
            .open_or_create()
        )
        self.events: Any = (
            self.node.service_builder(name)
            .event()
            .max_listeners(work.subscribers)
            .max_nodes(ends)
            .open_or_create()
        )


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
    is_notified, is_loaned = work.take_by == "event", work.publish_by == "loan"
    body = text_of(work.size).encode() if is_loaned else b""

    def send(text: str) -> None:
        data, reached = text.encode(), 0
        while not reached:
            sample = loan()
            place = sample.payload_ptr
            if body:
                move(place, body, len(body))
            move(place, data, len(data))
            reached = sample.assume_init().send()
            if is_notified:
                notify()

    port.update_connections()
    number = services.samples.dynamic_config.number_of_subscribers
    if number != work.subscribers:
        raise RuntimeError(f"{number} subscribers")
    await roles.publish(parent, _heads_of(work) if is_loaned else work, send)


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    services = _Services(work)
    taker = roles.Taker(parent, work)
    port: Any = services.samples.subscriber_builder().create()
    listener: Any = services.events.listener_builder().create()
    receive = port.receive
    wait = listener.blocking_wait
    is_waiting = work.take_by == "event"
    size = (_heads_of(work) if work.publish_by == "loan" else work).size
    payload_at = (ctypes.c_uint8 * size).from_address

    def take() -> str:
        while True:
            sample = receive()
            if sample is not None:
                return str(payload_at(sample.payload_ptr), "utf-8")
            if is_waiting:
                wait()

    roles.take_in_thread(taker, take)
    parent.tell("ready")
    await taker.finish()


def _heads_of(work: Work) -> Work:
    return msgspec.structs.replace(work, size=min(work.size, HEAD))


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
