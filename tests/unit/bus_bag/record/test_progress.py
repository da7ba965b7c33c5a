"""The line on the terminal."""

from bus_bag.record.progress import Progress

S = 1_000_000_000


def test_the_line() -> None:
    progress = Progress(0)
    line = progress.line(S, 10, 2_000_000, 0, 0, is_paused=False)
    assert line == "recording 0:00:01 | 10 messages | 2.0 MB/s | cache 0 B | lost 0"
    line = progress.line(3725 * S, 20, 2_000_000, 2048, 7, is_paused=True)
    assert line == "paused 1:02:05 | 20 messages | 0.0 MB/s | cache 2.0 KiB | lost 7"


def test_the_rate_is_that_of_the_last_seconds() -> None:
    progress = Progress(0)
    for second in range(1, 20):
        line = progress.line(
            second * S, 0, second * 5_000_000 if second < 10 else 45_000_000, 0, 0, is_paused=False
        )
    assert " 0.0 MB/s " in line
