"""busd.process.repetitions: the log has a repeated line only from time to time."""

import logging
from functools import partial

import pytest

from busd.process import repetitions
from busd.process.repetitions import Repetitions

SECOND = 1_000_000_000


def test_a_line_that_repeats_is_logged_again_after_a_rest(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = Repetitions()
    caplog.set_level(logging.DEBUG, "busd")
    for at_s, text in ((100, "a"), (101, "a"), (110.9, "a"), (120.9, "a"), (121, "b %s"), (122, "a")):
        now_ns = round(at_s * SECOND)
        monkeypatch.setattr(repetitions, "monotonic_ns", partial(int, now_ns))
        lines.log(logging.ERROR, text)
    assert [(one.levelname, one.getMessage()) for one in caplog.records] == [
        ("ERROR", "a"),
        ("DEBUG", "a"),
        ("DEBUG", "a"),
        ("ERROR", "a"),
        ("ERROR", "b %s"),
        ("ERROR", "a"),
    ]
