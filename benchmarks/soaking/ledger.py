"""Messages of one subscription: checks their content, order and number, and collects their ages. Pure."""

from collections.abc import Callable

from benchmarks.soaking.histogram import Histogram
from benchmarks.soaking.load import Stream, head_of

_MOST_FAULTS = 20


class Ledger:
    """Call `note` with every message of `stream`. Errors that must never happen go to `report`.

    `ages` are kept by talker until they are taken.
    """

    def __init__(self, stream: Stream, report: Callable[[str], None]) -> None:
        self.ages: dict[str, Histogram] = {}
        self._stream = stream
        self._report = report
        self._last: dict[str, int] = {}
        self._faults = 0

    def note(self, message: str, now_ns: int) -> None:
        """Check a message that has just arrived."""
        head = head_of(message, self._stream)
        if head is None:
            self._fault(f"damaged: {message[:80]!r}, {len(message)} characters")
            return
        last = self._last.get(head.talker, 0)
        if head.number <= last:
            self._fault(f"{head.talker}: {head.number} after {last}")
        elif head.number > last + 1 and self._stream.kind == "lossless":
            self._fault(f"{head.talker}: {last + 1} to {head.number - 1} are missing")
        self._last[head.talker] = head.number
        ages = self.ages.get(head.talker)
        if ages is None:
            ages = self.ages[head.talker] = Histogram()
        ages.add(now_ns - head.sent_ns)

    def take_ages(self) -> dict[str, Histogram]:
        """Remove and return the ages by talker."""
        taken, self.ages = self.ages, {}
        return taken

    def _fault(self, text: str) -> None:
        self._faults += 1
        if self._faults <= _MOST_FAULTS:  # the first faults show the reason
            self._report(f"{self._stream.topic}: {text}")


class Visit:
    """The messages that one late joiner got of a latched stream. `is_over` when it has enough of them.

    Enough are, from each of `talkers` talkers, all kept messages and a few more.
    """

    MORE = 3

    def __init__(self, stream: Stream, talkers: int) -> None:
        self.faults: list[str] = []
        self.count = 0
        self._stream = stream
        self._talkers = talkers
        self._heard: dict[str, list[tuple[int, int]]] = {}
        self._created_ns: int | None = None

    def created(self, now_ns: int) -> None:
        """Its subscription exists since now, or earlier."""
        self._created_ns = now_ns

    def note(self, message: str) -> None:
        """Check a message."""
        self.count += 1
        head = head_of(message, self._stream)
        if head is None:
            self.faults.append(f"damaged: {message[:80]!r}, {len(message)} characters")
            return
        heard = self._heard.setdefault(head.talker, [])
        if heard and head.number != heard[-1][0] + 1:
            self.faults.append(f"{head.talker}: {head.number} after {heard[-1][0]}")
        heard.append((head.number, head.sent_ns))

    @property
    def is_over(self) -> bool:
        """Whether it has enough messages of each talker, or a fault."""
        if self.faults:
            return True
        enough = [heard for heard in self._heard.values() if len(self._new(heard)) >= self.MORE]
        return len(enough) == self._talkers

    def verdict(self) -> list[str]:
        """Texts about faults, and about talkers with fewer messages than they kept."""
        short = [
            f"{talker}: {len(heard) - len(self._new(heard))} of the {self._stream.depth} that were kept"
            for talker, heard in self._heard.items()
            if heard[0][0] != 1 and len(heard) - len(self._new(heard)) < self._stream.depth
        ]
        return [f"{self._stream.topic}: a late joiner: {fault}" for fault in self.faults or short]

    def _new(self, heard: list[tuple[int, int]]) -> list[int]:
        """The messages that were certainly sent after the subscription existed, so they are not kept ones."""
        if self._created_ns is None:
            return []
        return [number for number, sent_ns in heard if sent_ns > self._created_ns]
