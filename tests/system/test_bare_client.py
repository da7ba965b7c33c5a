"""`examples/bare_client.py`, the client without the library, on a real busd and with the library's nodes."""

import signal
from pathlib import Path

import bus
from bus.msg.std_msgs import String
from conftest import Daemon
from programs import EXAMPLES, on_one_loop, running

CLIENT = EXAMPLES / "bare_client.py"


@on_one_loop
async def test_it_talks_and_continues_with_the_next_busd(daemon: Daemon, tmp_path: Path) -> None:
    async with bus.Node("test", arguments=()) as node:
        subscription = await node.create_subscription(String, "/topic", 1000)
        async with running(tmp_path, CLIENT, "talk") as talker:
            assert (await subscription.receive())[0].data == "Hello World: 1"
            daemon.kill()
            daemon.restart()
            texts = [(await subscription.receive())[0].data for _ in range(3)]
            talker.process.send_signal(signal.SIGTERM)
            assert await talker.end() == 0
    numbers = [int(text.removeprefix("Hello World: ")) for text in texts]
    assert numbers == sorted(set(numbers))
    assert numbers[0] > 1


@on_one_loop
async def test_it_listens(daemon: Daemon, tmp_path: Path) -> None:
    async with bus.Node("test", arguments=()) as node:
        publisher = await node.create_publisher(String, "/topic")
        async with running(tmp_path, CLIENT, "listen") as listener:
            await publisher.wait_for_subscriptions()
            for number in range(3):
                publisher.publish(String(data=f"text {number}"))
            await listener.line("text 2")
    assert listener.lines == [f"I heard: text {number}" for number in range(3)]
