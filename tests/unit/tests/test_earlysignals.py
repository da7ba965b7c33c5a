"""earlysignals: which end of a program is a fault of ours."""

import signal

import pytest

import bus
from earlysignals import judge

OURS = (
    f'Traceback (most recent call last):\n  File "{bus.__file__}", line 9, in <module>\nKeyboardInterrupt\n'
)
SITE = (
    'Traceback (most recent call last):\n  File "<frozen site>", line 616, in <module>\nKeyboardInterrupt\n'
)
PROGRAM = 'Traceback (most recent call last):\n  File "talker.py", line 5, in <module>\n    import bus\n'


@pytest.mark.parametrize(
    ("code", "said", "is_busd", "end"),
    [
        (-2, "", False, "by SIGINT"),
        (-2, "[INFO] [1.0] [talker]: Publishing\n", False, "by SIGINT"),
        (0, "", False, "BAD: 0"),
        (0, "[INFO] [1.0] [busd]: stopped: SIGINT\n", True, "stopped in order"),
        (0, "", True, "BAD: 0"),
        (-11, "", False, "BAD: -11"),
        (-2, OURS, False, "BAD: -2, Traceback"),
        (1, SITE, False, "before our first line"),
        (-2, PROGRAM, False, "before our first line"),
        (-2, f"{PROGRAM}{OURS}", False, "BAD: -2, Traceback"),
        (-2, "RuntimeWarning: coroutine 'main' was never awaited\n", False, "BAD: -2, never awaited"),
    ],
)
def test_ends(code: int, said: str, is_busd: bool, end: str) -> None:
    assert judge(code, said, signal.SIGINT, is_busd=is_busd) == end
