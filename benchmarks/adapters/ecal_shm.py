"""eclipse-ecal by its shared memory layer, with the handshake that makes it lossless.

`send` returns when all subscribers have taken the message. Without `acknowledge_timeout_ms`, the next message
would overwrite it, and more buffers (`memfile_buffer_count`) do not prevent that. `zero_copy_mode` saves a
copy in the subscriber. The callback runs in a thread of eCAL.

Publishers and subscribers also find each other by shared memory, in a separate domain for each run. They
register every 100 ms. With the default of one second they need two seconds to match. There are two exceptions
with the default: systems measured as shipped (BENCH_ECAL_SHIPPED), and a `Work` without messages, for
measurements of idle systems. This module removes the domain's files, because eCAL leaves them.
"""

import asyncio
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import ecal.nanobind_core as ecal

from benchmarks.adapters import roles
from benchmarks.work import Work
from benchmarks.worker import LIFE_S, Parent, options, run

_REFRESH_MS = 100
_TEXT = ecal.DataTypeInformation("string", "utf-8")


@contextmanager
def _joined(role: str, work: Work) -> Iterator[str]:
    """Initialize eCAL for the block; yields the topic's name."""
    config = ecal.get_configuration()
    name = Path(os.environ["BENCH_FOLDER"]).name
    registration = config.registration
    registration.local.transport_type = ecal.LocalTransportType.SHM
    registration.local.shm.domain = registration.shm_transport_domain = name
    if work.total and not os.environ.get("BENCH_ECAL_SHIPPED"):
        registration.registration_refresh = _REFRESH_MS
    config.logging.provider.udp.enable = False
    ecal.initialize(config, role, ecal.init.PUBLISHER | ecal.init.SUBSCRIBER)
    try:
        yield name
    finally:
        ecal.finalize()
        for left in (name, f"{name}_mtx"):
            Path("/dev/shm", left).unlink(missing_ok=True)


async def publisher(parent: Parent) -> None:
    work: Work = options(Work)
    loop, reached = asyncio.get_running_loop(), asyncio.Event()

    def count(*_: object) -> None:
        if port.get_subscriber_count() == work.subscribers:
            loop.call_soon_threadsafe(reached.set)

    with _joined("publisher", work) as name:
        config = ecal.get_publisher_configuration()
        config.layer.udp.enable = config.layer.tcp.enable = False
        config.layer.shm.acknowledge_timeout_ms = 1000 * LIFE_S
        config.layer.shm.zero_copy_mode = True
        port: Any = ecal.Publisher(name, _TEXT, config, count)
        await reached.wait()
        send = port.send
        await roles.publish(parent, work, lambda text: send(text.encode()))


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    taker = roles.Taker(parent, work)
    take = taker.take
    with _joined("subscriber", work) as name:
        port: Any = ecal.Subscriber(name, _TEXT)
        port.set_receive_callback(lambda publisher, kind, data: take(data.buffer.decode()))
        parent.tell("ready")
        try:
            await taker.finish()
        finally:
            port.remove_receive_callback()


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
