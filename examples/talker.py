"""The lesson's publisher: a message twice a second."""

from itertools import count

import bus
from bus.msg.std_msgs import String


async def main() -> None:
    async with bus.Node("minimal_publisher") as node:
        publisher = await node.create_publisher(String, "topic", 10)
        numbers = count()

        def publish_next() -> None:
            message = String(data=f"Hello World: {next(numbers)}")
            node.get_logger().info(f'Publishing: "{message.data}"')
            publisher.publish(message)

        node.create_timer(0.5, publish_next)
        await node.spin()


bus.run(main())
