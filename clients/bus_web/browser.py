"""Starts the user's browser with a page."""

import threading
import webbrowser
from collections.abc import Callable

__all__ = ["open_browser"]


def open_browser(address: str, complain: Callable[[str], object]) -> None:
    """Returns at once; some browsers return when they are closed. `complain` is called if there is none."""

    def show() -> None:
        if not webbrowser.open(address):
            complain("no browser was found: open the page yourself")

    threading.Thread(target=show, daemon=True).start()
