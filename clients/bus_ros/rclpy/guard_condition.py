"""Guard conditions: callbacks that any thread can trigger, and an executor calls."""

from collections.abc import Callable

from bus.base.callbacks import is_async
from bus_ros.engine import engine
from bus_ros.entity import Entity, Group, Owner, Work
from bus_ros.rclpy.destroyable import Handled

__all__ = ["GuardCondition"]


class GuardCondition(Entity, Handled):
    """Made by `Node.create_guard_condition`."""

    is_single = True
    rank = 3

    def __init__(self, callback: Callable[[], object], callback_group: Group, node: Owner) -> None:
        self.callback = callback
        self.is_async = is_async(callback)
        self._is_triggered = False
        super().__init__(node, callback_group)

    def trigger(self) -> None:
        """Let the executor call the callback; several triggers before the call count as one. From any thread.

        Raises InvalidHandle if it is destroyed.
        """
        self.handle.check()
        engine().call(self._trigger)

    def destroy(self) -> None:
        self.node.destroy_guard_condition(self)

    def take(self, most: int) -> Work | None:
        was_triggered, self._is_triggered = self._is_triggered, False
        return (self.callback, ()) if was_triggered else None

    def _trigger(self) -> None:
        self._is_triggered = True
        self.notify()
