"""Actuation: applies valid velocity commands, refuses others, and stops the robot without commands."""

from time import monotonic

import bus
from bus.msg.geometry_msgs import Twist
from common import APPLIED, BOUNDS, COMMAND, COMMAND_TIMEOUT_S


def violation(command: Twist) -> str | None:
    """A text about the first field out of its bounds; None for a valid command."""
    for part in ("linear", "angular"):
        for axis in ("x", "y", "z"):
            field = f"{part}.{axis}"
            value = getattr(getattr(command, part), axis)
            low, high = BOUNDS.get(field, (0.0, 0.0))
            if not low <= value <= high:  # the condition is also true for NaN
                return f"{field} is {value:g}, allowed is {low:g} to {high:g}"
    return None


class Motors:
    """Applies commands and publishes the applied ones."""

    def __init__(self, applied: bus.Publisher[Twist], logger: bus.Logger) -> None:
        self._applied = applied
        self._logger = logger
        self._commanded_s: float | None = None

    def obey(self, command: Twist) -> None:
        problem = violation(command)
        if problem is not None:
            self._logger.warning(f"refused a command: {problem}")
            return
        self._commanded_s = monotonic()
        self._applied.publish(command)

    def watch(self) -> None:
        """Stop the robot if commands stop."""
        if self._commanded_s is not None and monotonic() - self._commanded_s > COMMAND_TIMEOUT_S:
            self._logger.warning(f"no command for {COMMAND_TIMEOUT_S:g} s: stopped")
            self._commanded_s = None
            self._applied.publish(Twist())


async def main() -> None:
    async with bus.Node("actuation") as node:
        applied = await node.create_publisher(APPLIED.type, APPLIED.name, APPLIED.qos)
        motors = Motors(applied, node.get_logger())
        await node.create_subscription(COMMAND.type, COMMAND.name, COMMAND.qos, motors.obey)
        node.create_timer(COMMAND_TIMEOUT_S / 5, motors.watch)
        await node.spin()


if __name__ == "__main__":
    bus.run(main())
