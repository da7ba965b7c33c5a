"""busd.core.rate_limit: a burst at once, then a rate per second."""

from hypothesis import given
from hypothesis import strategies as st

from busd.core.rate_limit import TokenBucket

SECOND = 1_000_000_000
STEPS = st.lists(st.tuples(st.integers(0, 3 * SECOND), st.integers(1, 12)), max_size=60)


def try_to_take(bucket: TokenBucket, now_ns: int, tokens: int) -> bool:
    is_there = bucket.has(now_ns, tokens)
    assert bucket.take_if_there(now_ns, tokens) is is_there
    return is_there


def test_the_burst_then_the_rate() -> None:
    bucket = TokenBucket(10, 5)
    assert [try_to_take(bucket, 0, 1) for _ in range(6)] == [True] * 5 + [False]
    assert not try_to_take(bucket, SECOND // 10 - 1, 1)
    assert try_to_take(bucket, SECOND // 10, 1)
    assert not try_to_take(bucket, SECOND // 10, 1)


def test_a_rest_fills_it_and_no_more() -> None:
    bucket = TokenBucket(10, 5)
    bucket.take(0, 5)
    assert not bucket.is_full(SECOND // 2 - 1)
    assert bucket.is_full(SECOND // 2)
    assert [try_to_take(bucket, 100 * SECOND, 1) for _ in range(6)] == [True] * 5 + [False]


def test_what_is_more_than_it_holds_needs_it_full() -> None:
    bucket = TokenBucket(10, 5)
    assert try_to_take(bucket, 0, 1000)
    assert not bucket.has(SECOND, 1000)
    assert bucket.has(100 * SECOND, 1000)


def test_how_long_until_nothing_is_owed() -> None:
    bucket = TokenBucket(10, 5)
    bucket.take(0, 5)
    assert bucket.owed_ns(0) == 0
    bucket.take(0, 3)
    assert bucket.owed_ns(0) == 3 * SECOND // 10
    assert bucket.owed_ns(SECOND // 5) == SECOND // 10
    assert bucket.owed_ns(SECOND) == 0


def test_what_is_owed_is_bounded() -> None:
    """The debt is at most one second's tokens: the bucket is full one second later than without a debt."""
    bucket = TokenBucket(10, 5)
    for _ in range(1000):
        bucket.take(0, 100)
    assert not bucket.has(SECOND, 1)
    assert bucket.has(SECOND + SECOND // 10, 1)
    assert bucket.is_full(SECOND + SECOND // 2)


def test_another_rate() -> None:
    bucket = TokenBucket(10, 5)
    bucket.take(0, 5)
    bucket.resize(10, 8)
    assert [try_to_take(bucket, 0, 1) for _ in range(4)] == [True] * 3 + [False]
    bucket.resize(1, 1)
    assert not bucket.has(0, 1)


@given(rate=st.integers(1, 50), burst=st.integers(1, 20), steps=STEPS)
def test_against_a_count_of_tokens(rate: int, burst: int, steps: list[tuple[int, int]]) -> None:
    """The model counts tokens in nanoseconds of their rate. TokenBucket stores only the time at which it is
    full.
    """
    step_ns = SECOND // rate
    bucket, level_ns, now_ns = TokenBucket(rate, burst), burst * step_ns, 0
    for pause_ns, tokens in steps:
        now_ns += pause_ns
        level_ns = min(level_ns + pause_ns, burst * step_ns)
        is_there = level_ns >= min(tokens, burst) * step_ns
        assert bucket.has(now_ns, tokens) == is_there
        assert bucket.is_full(now_ns) == (level_ns == burst * step_ns)
        assert bucket.take_if_there(now_ns, tokens) is is_there
        if is_there:
            level_ns = max(level_ns - tokens * step_ns, -SECOND)


@given(rate=st.integers(1, 50), burst=st.integers(1, 20), steps=STEPS)
def test_never_more_than_rate_and_burst_say(rate: int, burst: int, steps: list[tuple[int, int]]) -> None:
    bucket, now_ns, taken = TokenBucket(rate, burst), 0, 0
    for pause_ns, tokens in steps:
        now_ns += pause_ns
        if tokens <= burst and try_to_take(bucket, now_ns, tokens):
            taken += tokens
        assert taken * (SECOND // rate) <= now_ns + burst * (SECOND // rate)
