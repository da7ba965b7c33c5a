"""The console log, and a Ctrl-C at any moment."""

import io
import itertools
import logging
import sys
import threading
from types import FrameType

import pytest

from bus.logger import ConsoleHandler


def test_ctrl_c_leaves_no_lock_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """After a Ctrl-C at any moment, another thread can log."""
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    handler = ConsoleHandler({})
    lock = handler.lock
    assert isinstance(lock, type(threading.RLock()))

    class Interrupt:
        """Raises KeyboardInterrupt at the call or return with the given number. Python checks for signals
        there.
        """

        def __init__(self, number: int) -> None:
            self.left = number

        def __call__(self, frame: FrameType, event: str, _: object) -> None:
            self.left -= event in ("call", "return", "c_return")
            if not self.left:
                raise KeyboardInterrupt

    for number in itertools.count(1):
        sys.setprofile(Interrupt(number))
        try:
            handler.handle(logging.makeLogRecord({"levelno": 20, "msg": "hi"}))
        except KeyboardInterrupt:
            assert not lock._is_owned(), number  # type: ignore[attr-defined]
        else:
            break
        finally:
            sys.setprofile(None)
    assert number > 50
