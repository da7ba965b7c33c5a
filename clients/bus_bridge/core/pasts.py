"""The last state of each route in after its far publisher has gone, for a publisher that comes back. Pure."""

from collections import OrderedDict
from typing import NamedTuple

from bus_bridge.core.accounts import Account

__all__ = ["Past", "Pasts"]

_MOST = 4096
_KEEP_S = 600.0


class Past(NamedTuple):
    """The state of a publisher's route in at its end."""

    last: int
    """The number of the last message; 0 without any."""
    listeners: frozenset[bytes]
    """The subscriptions at that time, by gid. Messages that they have missed since then are lost."""
    account: Account
    lost_before: dict[str, int]
    """Messages lost in its readers, by reason."""
    numbering: str = ""
    """The numbering of `last`: empty for the publisher's own numbers. In transit it names the mirror, because
    numbers of different mirrors can't be compared."""
    newest_ns: int = 0
    """Time of the last message, by the publisher's clock. It is the same on each way."""


class Pasts:
    """Last states by gid. Keeps the newest ones, at most `most`, each for `keep_s` seconds."""

    def __init__(self, most: int = _MOST, keep_s: float = _KEEP_S) -> None:
        self._most = most
        self._keep_s = keep_s
        self._known: OrderedDict[bytes, tuple[float, Past]] = OrderedDict()

    def keep(self, gid: bytes, past: Past, now_s: float) -> None:
        self._known.pop(gid, None)
        self._known[gid] = now_s, past
        self._forget(now_s)

    def take(self, gid: bytes, now_s: float) -> Past | None:
        """Remove and return the state of a publisher; None if the publisher is new, or was away for too
        long."""
        self._forget(now_s)
        found = self._known.pop(gid, None)
        return None if found is None else found[1]

    def _forget(self, now_s: float) -> None:
        known = self._known
        while known and (len(known) > self._most or now_s - next(iter(known.values()))[0] > self._keep_s):
            known.popitem(last=False)
