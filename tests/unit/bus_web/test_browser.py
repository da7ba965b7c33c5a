"""The start of a browser, and the message if there is none."""

import queue
import webbrowser

import pytest

from bus_web.browser import open_browser


def test_one_that_is_there_and_one_that_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    opened, told = queue.Queue[str](), queue.Queue[str]()
    monkeypatch.setattr(webbrowser, "open", lambda address: opened.put(address) or address == "there")
    open_browser("there", told.put)
    assert opened.get(timeout=10) == "there"
    open_browser("nowhere", told.put)
    assert opened.get(timeout=10) == "nowhere"
    assert told.get(timeout=10) == "no browser was found: open the page yourself"
    assert told.empty()
