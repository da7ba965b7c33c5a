"""How often something may be done: a bucket of tokens, kept as one number. Knows no clock."""

__all__ = ["TokenBucket"]

_SECOND_NS = 1_000_000_000


class TokenBucket:
    """`rate` tokens a second for long, and `burst` at once after a rest.

    It only keeps the time when the bucket will be full again; each token taken puts that off by 1 / `rate`
    seconds.
    """

    __slots__ = ("_burst_ns", "_full_ns", "_step_ns")

    def __init__(self, rate: int, burst: int) -> None:
        self._full_ns = 0
        self.resize(rate, burst)

    def resize(self, rate: int, burst: int) -> None:
        """Use this rate and burst from now on; tokens taken in advance stay owed."""
        self._step_ns = _SECOND_NS // rate
        self._burst_ns = burst * self._step_ns

    def has(self, now_ns: int, tokens: int) -> bool:
        """Whether `tokens` tokens are there. If the bucket holds fewer, it must be full."""
        owed_ns = max(self._full_ns - now_ns, 0)
        return owed_ns + min(tokens * self._step_ns, self._burst_ns) <= self._burst_ns

    def take_if_there(self, now_ns: int, tokens: int) -> bool:
        """Take `tokens` if they are there, as `has` says; returns whether they were."""
        full_ns = max(self._full_ns, now_ns)
        if full_ns - now_ns + min(tokens * self._step_ns, self._burst_ns) > self._burst_ns:
            return False
        self._full_ns = min(full_ns + tokens * self._step_ns, now_ns + self._burst_ns + _SECOND_NS)
        return True

    def wait_ns(self, now_ns: int) -> int:
        """How long it takes until there is a token."""
        return max(self._full_ns + self._step_ns - self._burst_ns - now_ns, 0)

    def owed_ns(self, now_ns: int) -> int:
        """How long until the tokens taken in advance are back."""
        return max(self._full_ns - now_ns - self._burst_ns, 0)

    def take(self, now_ns: int, tokens: int) -> None:
        """Take `tokens`, whether they are there or not; the debt is at most the tokens of one second."""
        full_ns = max(self._full_ns, now_ns) + tokens * self._step_ns
        self._full_ns = min(full_ns, now_ns + self._burst_ns + _SECOND_NS)

    def is_full(self, now_ns: int) -> bool:
        """Whether the bucket is full."""
        return self._full_ns <= now_ns
