"""A reader does not return to the next busd: a publisher that waited for it continues."""

import asyncio
import random
from pathlib import Path

import pytest

import bus
from bus import shm
from bus.delivery import shm_sender
from conftest import Daemon
from nursery import Nursery
from survivors import TOPIC, Ear, Parcel


@pytest.mark.skipif(not shm.is_available(), reason=shm.why_not() or "-")
async def test_a_lossless_publisher_goes_on(
    daemon: Daemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shm_sender, "RETURN_S", 0.1)
    parcel = Parcel(talker=1, number=1, is_certain=False, checksum=0, body=bytes(10_000))
    with Nursery(tmp_path, random.Random(1)) as nursery:
        listener = nursery.listener(Ear(gaps="any")).ready()
        async with bus.Node("talker") as node:
            publisher = await node.create_publisher(Parcel, TOPIC, bus.QoSProfile(history="keep_all"))
            await publisher.wait_for_subscriptions()
            listener.stop()
            while publisher.publish(parcel):
                pass
            waits = asyncio.create_task(publisher.send(parcel))
            await asyncio.sleep(0)
            daemon.kill()
            daemon.restart()
            await waits
            assert not publisher.get_subscription_count()
