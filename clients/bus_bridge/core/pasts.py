"""The last state of each way in whose far publisher has gone, in case the publisher comes back. Pure."""

from collections import OrderedDict
from typing import NamedTuple

from bus_bridge.core.accounts import Account

__all__ = ["Past", "Pasts"]

_MOST = 4096
_KEEP_S = 600.0


class Past(NamedTuple):
    """The way in of a publisher, as it was when that went."""

    last: int
    """The number of the last message that came; 0 for none."""
    listeners: frozenset[bytes]
    """The subscriptions at that time, by gid. Messages that they have missed since then are lost."""
    account: Account
    lost_before: dict[str, int]
    """Messages that its readers had and lost, by reason."""
    numbering: str = ""
    """The numbering of `last`: that of the publisher itself, or, in transit, of the mirror named here.
    Numbers of different mirrors can't be compared."""
    newest_ns: int = 0
    """When the last message was published, by the publisher's clock: the same by each way."""


class Pasts:
    """By gid. Keeps at most `most`, the newest ones, each for `keep_s` seconds."""

    def __init__(self, most: int = _MOST, keep_s: float = _KEEP_S) -> None:
        self._most = most
        self._keep_s = keep_s
        self._known: OrderedDict[bytes, tuple[float, Past]] = OrderedDict()

    def keep(self, gid: bytes, past: Past, now_s: float) -> None:
        self._known.pop(gid, None)
        self._known[gid] = now_s, past
        self._forget(now_s)

    def take(self, gid: bytes, now_s: float) -> Past | None:
        """None if the publisher is new, or was away for too long."""
        self._forget(now_s)
        found = self._known.pop(gid, None)
        return None if found is None else found[1]

    def _forget(self, now_s: float) -> None:
        known = self._known
        while known and (len(known) > self._most or now_s - next(iter(known.values()))[0] > self._keep_s):
            known.popitem(last=False)
