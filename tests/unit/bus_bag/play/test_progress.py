"""The progress line of a replay."""

from bus_bag.play.progress import Progress, Status

START = 1_795_342_862_882_115_714


def test_the_line() -> None:
    at = Progress(START + 1_234_500_000, START, START + 4_862_642_592, 1.0, 1820, Status.RUNNING)
    assert str(at) == "[1795342864.116615714] 1.23/4.86 s [R] rate 1, 1820 messages"


def test_at_the_edges() -> None:
    before = Progress(START - 5, START, START, 0.25, 1, Status.PAUSED)
    assert str(before) == "[1795342862.882115709] 0.00/0.00 s [P] rate 0.25, 1 message"
    assert str(before._replace(bag_ns=START + 10**9)).startswith("[1795342863.882115714] 0.00/0.00 s")
