"""`bus bridge ros2 --rmw zenoh` with pyzeros, an independent implementation of rmw_zenoh's protocol."""

import asyncio

import pytest

import bus
from bridged_world import on_one_loop, until
from bus.msg.std_msgs import String
from bus.srv.std_srvs import SetBool
from peers.peer import PROGRAMS, ROOT, Peer
from rmw_zenoh_bridged import Ros, ask, ros

__all__ = ["ros"]

PYTHON = ROOT / ".venv-zeros" / "bin" / "python"
has_pyzeros = any(PYTHON.parents[1].glob("lib/python*/site-packages/pyzeros"))
pytestmark = pytest.mark.skipif(not has_pyzeros, reason="pyzeros is not installed: make peers")


def zeros(ros: Ros) -> Peer:
    command = (str(PYTHON), str(PROGRAMS / "zeros.py"), "zeros", ros.router.address, str(ros.domain))
    # `make peers` has compiled its codecs there: that takes half a minute.
    codecs = str(PYTHON.parents[1] / "codecs")
    return Peer(command, {"PYTHONPATH": "", "CYDR_CACHE_DIR": codecs}, ros.side.machine)


@on_one_loop
async def test_topics_and_services_cross_in_both_directions(ros: Ros) -> None:
    ros.bridge()
    heard: list[str] = []
    with zeros(ros) as far:
        async with ros.side.node("node") as node:
            await node.create_subscription(String, "/theirs", 1000, lambda one: heard.append(one.data))
            publisher = await node.create_publisher(String, "/ours", 1000)
            await node.create_service(
                SetBool, "/ours_set", lambda one: SetBool.Response(success=one.data, message="ours")
            )
            client = await node.create_client(SetBool, "/theirs_set")
            graph = await ros.side.shows(lambda graph: graph.publishers_of("/theirs"))
            assert "/zeros" in {one.full_name for one in graph.nodes}
            assert graph.publishers_of("/theirs")[0].qos == bus.QoSProfile(10)
            await publisher.wait_for_subscriptions()
            publisher.publish(String(data="begin"))
            assert await asyncio.to_thread(far.wait, "/ours") == ["begin"]
            for number in range(100):
                publisher.publish(String(data=str(number)))
            found = await asyncio.to_thread(far.wait, "/ours", 101)
            assert found[1:] == [str(one) for one in range(100)]
            await ask(far, "send", count=1)
            await until(lambda: heard)  # now the route is there
            await ask(far, "send", count=100)
            await until(lambda: len(heard) == 101, lambda: str(len(heard)))
            assert heard == ["0", *(str(one) for one in range(100))]
            for data in (True, False):
                assert await ask(far, "call", data=data) == [data, "ours"]
                await client.wait_for_service()
                answer = await client.call(SetBool.Request(data=data))
                assert answer == SetBool.Response(success=data, message="theirs")
