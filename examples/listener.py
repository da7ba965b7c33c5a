"""The lesson's subscriber: says what it hears."""

import bus
from bus.msg.std_msgs import String


async def main() -> None:
    async with bus.Node("minimal_subscriber") as node:
        subscription = await node.create_subscription(String, "topic", 10)
        async for message in subscription:
            if message.data:
                node.get_logger().info(f'I heard: "{message.data}"')
            else:
                node.get_logger().warning("Received empty message")


bus.run(main())
