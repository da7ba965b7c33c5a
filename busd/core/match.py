"""The states of a match, the events that may happen in each of them, and the state that follows.

Owns the table and nothing else. The matches themselves, and the tables of their ends that follow from their
states, are in `busd.core.entities`.
"""

from collections.abc import Mapping
from enum import Enum

__all__ = ["SHARED", "TRANSITIONS", "MatchError", "MatchEvent", "MatchState"]


class MatchState(Enum):
    """State of a match."""

    __hash__ = object.__hash__  # Enum's own is a call in Python

    NEW = "new"
    """Its route is not chosen yet."""
    OFFERED = "offered"
    """On the route shm: busd has sent the subscription the ring (Matched)."""
    ATTACHED = "attached"
    """On the route shm: the subscription reads the ring."""
    LEAVING = "leaving"
    """On the route socket: the subscription has yet to say how far it has read the ring (LeaveRing)."""
    BRIDGED = "bridged"
    """On the route bridge: the subscription stands for another, and gets nothing here."""
    CATCHING_UP = "catching up"
    """The publisher sends missed samples to this subscription alone; samples for all are not for it yet."""
    AHEAD = "ahead"
    """The subscription has had samples that the publisher is yet to send again: it gets only later ones."""
    ROUTED = "routed"
    """The subscription gets what all get."""
    ENDED = "ended"
    """One of the two ends is gone."""


class MatchEvent(Enum):
    """What happens to a match."""

    __hash__ = object.__hash__

    SHARE = "share"
    """Both ends can share memory."""
    BRIDGE = "bridge"
    """The subscription is a mirror: its samples cross by a tap."""
    ROUTE = "route"
    """The next sample that goes to all is for the subscription, too."""
    ROUTE_AHEAD = "route ahead"
    """The same, but it has had that sample, and maybe more."""
    CATCH_UP = "catch up"
    """The subscription was lost and is back: the publisher has kept the samples that it missed."""
    ATTACH = "attach"
    """The subscription has found the ring (Attach)."""
    REROUTE = "reroute"
    """The ring can't be used: one end refuses it, or it was lost."""
    LEAVE = "leave"
    """The subscription has left the ring (LeaveRing)."""
    REACH = "reach"
    """The publisher sends something that the subscription has not had."""
    END = "end"
    """One of the two ends goes."""


_State, _Event = MatchState, MatchEvent

TRANSITIONS: Mapping[MatchState, Mapping[MatchEvent, MatchState]] = {
    _State.NEW: {
        _Event.SHARE: _State.OFFERED,
        _Event.BRIDGE: _State.BRIDGED,
        _Event.ROUTE: _State.ROUTED,
        _Event.ROUTE_AHEAD: _State.AHEAD,
        _Event.CATCH_UP: _State.CATCHING_UP,
    },
    _State.OFFERED: {
        _Event.ATTACH: _State.ATTACHED,
        _Event.REROUTE: _State.LEAVING,
        _Event.END: _State.ENDED,
    },
    _State.ATTACHED: {_Event.REROUTE: _State.LEAVING, _Event.END: _State.ENDED},
    _State.BRIDGED: {_Event.END: _State.ENDED},
    _State.LEAVING: {_Event.LEAVE: _State.CATCHING_UP, _Event.END: _State.ENDED},
    _State.CATCHING_UP: {
        _Event.ROUTE: _State.ROUTED,
        _Event.ROUTE_AHEAD: _State.AHEAD,
        _Event.END: _State.ENDED,
    },
    _State.AHEAD: {_Event.REACH: _State.ROUTED, _Event.END: _State.ENDED},
    _State.ROUTED: {_Event.END: _State.ENDED},
    _State.ENDED: {},
}
"""The next state, by state and event. An event that a state's row lacks must not happen there."""

SHARED = (MatchState.OFFERED, MatchState.ATTACHED)
"""The states on the route shm."""


class MatchError(Exception):
    """Something happened to a match that can't happen in its state: a bug of busd, and no peer's fault."""
