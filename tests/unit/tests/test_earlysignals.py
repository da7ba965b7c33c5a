"""earlysignals: the ends of a program that are faults of busd."""

import signal

import pytest

import bus
import busd
from earlysignals import judge

BEGIN = "Traceback (most recent call last):\n"
END = "KeyboardInterrupt\n"
OURS = f'{BEGIN}  File "{bus.__file__}", line 9, in <module>\n{END}'
SITE = f'{BEGIN}  File "<frozen site>", line 616, in <module>\n{END}'
MAIN = f'{BEGIN}  File "{busd.__path__[0]}/__main__.py", line 5, in <module>\n{END}'
PROGRAM = f'{BEGIN}  File "talker.py", line 5, in <module>\n    import bus\n{END}'


@pytest.mark.parametrize(
    ("code", "said", "in_order", "end"),
    [
        (-2, "", None, "by SIGINT"),
        (-2, "[INFO] [1.0] [talker]: Publishing\n", None, "by SIGINT"),
        (0, "", None, "BAD: 0"),
        (0, "[INFO] [1.0] [busd]: stopped: SIGINT\n", "stopped: SIGINT", "in order"),
        (0, "", "stopped: SIGINT", "BAD: 0"),
        (0, "", "", "in order"),
        (-11, "", None, "BAD: -11"),
        (-2, OURS, None, "BAD: -2"),
        (1, SITE, None, "before our first line"),
        (1, "KeyboardInterrupt\n", None, "before our first line"),
        (1, "Fatal Python error: init_import_site\nKeyboardInterrupt\n", None, "before our first line"),
        (1, "busd: no room\n", "stopped: SIGINT", "BAD: 1"),
        (-2, MAIN, None, "before our first line"),
        (-2, PROGRAM, None, "before our first line"),
        (-2, f"{PROGRAM}{OURS}", None, "BAD: -2"),
        (-2, "RuntimeWarning: coroutine 'main' was never awaited\n", None, "BAD: -2"),
    ],
)
def test_ends(code: int, said: str, in_order: str | None, end: str) -> None:
    assert judge(code, said, signal.SIGINT, in_order=in_order) == end
