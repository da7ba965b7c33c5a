"""The form in which our nodes are listed: of ROS 2 Humble, or of later distros. Pure.

The forms differ in the size of gids. Readers of one form don't understand writers of the other.
"""

from collections.abc import Callable, Iterable

from bus_bridge.dds.graph import GID_SIZE, HUMBLE_GID_SIZE
from bus_bridge.dds.options import Distro

__all__ = ["NodeForm", "size_of"]


class NodeForm:
    """The form for `distro`; with `auto` it follows the participants found.

    `warn` gets texts for the user.
    """

    def __init__(self, distro: Distro, warn: Callable[[str], None]) -> None:
        self.size = size_of(is_humble=distro == "humble")
        """The size of gids in it."""
        self._is_fixed = distro != "auto"
        self._warn = warn

    def follow(self, size: int, present: Iterable[int]) -> bool:
        """A participant lists its nodes with gids of `size` bytes; returns whether our form changes.

        `present`: the sizes of all participants.
        """
        if self._is_fixed or size == self.size:
            return False
        if len({*present}) == 2:
            self._warn(
                "nodes of ROS 2 Humble and of later distros are in this domain: they can't see each "
                "other's nodes, and nodes of Humble don't see the nodes of this bus (their topics work)"
            )
            if size == HUMBLE_GID_SIZE:
                return False
        self.size = size
        return True


def size_of(*, is_humble: bool) -> int:
    """The size of gids in a form."""
    return HUMBLE_GID_SIZE if is_humble else GID_SIZE
