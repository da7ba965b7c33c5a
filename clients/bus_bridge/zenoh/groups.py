"""Groups of buses: which buses of a fleet see each other. Pure.

A bus is in one group or in none. It sees all buses, or the buses of chosen groups. Two buses see each other
if each of them sees the other one. So a robot can see its operators, and not 999 other robots.

The run of a bridge is a part of all its tokens, and begins with its groups. So a bridge asks for the tokens
of the groups that it sees, and receives no others:

    <group>~<seen group>~<seen group>~~<id>     no seen group: it sees all; an empty group: it is in none
    <id>                                        in no group, and sees all
"""

from typing import Final, NamedTuple

__all__ = ["MOST_SEEN", "Groups", "own_part", "read_run", "write_run"]

MOST_SEEN: Final = 16
_MARK: Final = "~"
"""No group has it in its name, and it needs no encoding in a key."""


class Groups(NamedTuple):
    """The groups of a bus."""

    own: str = ""
    """Empty: none."""
    seen: tuple[str, ...] = ()
    """Empty: it sees all buses, also those without a group."""

    def sees(self, other: "Groups") -> bool:
        """Whether this bus sees the other one."""
        return not self.seen or other.own in self.seen

    def __str__(self) -> str:
        place = f"in the group '{self.own}'" if self.own else "in no group"
        return f"{place}, sees {', '.join(self.seen) if self.seen else 'all buses'}"


def write_run(groups: Groups, run: str) -> str:
    """The run of a bridge with these groups. `run`: its own part, without the mark."""
    return run if groups == Groups() else f"{_MARK.join((groups.own, *groups.seen))}{_MARK * 2}{run}"


def read_run(run: str) -> Groups:
    """The groups in the run of a bridge. Any text is one."""
    own, *seen = run.rpartition(_MARK * 2)[0].split(_MARK)
    return Groups(own, tuple(seen))


def own_part(run: str) -> str:
    """The part of a run that has nothing to do with groups."""
    return run.rpartition(_MARK * 2)[2]
