"""Changes in the graph since the last report to its observers, and the number of that revision."""

from bus.wire.messages import EndpointRecord, GraphChanged, MatchRecord, NodeRecord

__all__ = ["Changes"]


class Changes:
    """Records that came and went. The graph adds to the lists; `take` empties them."""

    def __init__(self) -> None:
        self.revision = 0
        """Revision of the graph as observers know it."""
        self.nodes_added: list[NodeRecord] = []
        self.nodes_removed: list[int] = []
        self.endpoints_added: list[EndpointRecord] = []
        self.endpoints_removed: list[int] = []
        self.matches_added: list[MatchRecord] = []
        self.matches_removed: list[MatchRecord] = []

    def take(self) -> GraphChanged | None:
        """The changes since the last call, as the next revision."""
        if not (
            self.nodes_added
            or self.nodes_removed
            or self.endpoints_added
            or self.endpoints_removed
            or self.matches_added
            or self.matches_removed
        ):
            return None
        self.revision += 1
        change = GraphChanged(
            revision=self.revision,
            nodes_added=tuple(self.nodes_added),
            nodes_removed=tuple(self.nodes_removed),
            endpoints_added=tuple(self.endpoints_added),
            endpoints_removed=tuple(self.endpoints_removed),
            matches_added=tuple(self.matches_added),
            matches_removed=tuple(self.matches_removed),
        )
        for pending in (
            self.nodes_added,
            self.nodes_removed,
            self.endpoints_added,
            self.endpoints_removed,
            self.matches_added,
            self.matches_removed,
        ):
            pending.clear()
        return change

    def skip_revision(self) -> int:
        """Begin a revision that only changes which parts observers may see; returns it."""
        self.revision += 1
        return self.revision
