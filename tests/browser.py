"""A headless Chromium, for tests of the page."""

import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from conftest import WAIT_S
from vendoring import AXE

_FAULTS = """
const done = arguments[arguments.length - 1];
axe.run(document, {runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'best-practice']})
  .then(result => done(result.violations.map(one => [one.impact, one.id,
    one.nodes.slice(0, 3).map(node => node.target.join() + ': ' + node.failureSummary)])))
"""
_LOOK_S = 0.05
_SIZE = (1360, 960)


def need_chromium() -> tuple[str, str]:
    """The paths of the browser and its driver; skips the test without them."""
    browser, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if browser is None or driver is None:
        pytest.skip("no chromium with its driver (Debian: apt install chromium chromium-driver)")
    return browser, driver


class Page:
    """An open page."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open(self, address: str) -> None:
        self.driver.get(address)

    def run(self, script: str, *arguments: object) -> Any:
        """Run a script; returns its result."""
        return self.driver.execute_script(script, *arguments)

    def wait(self, script: str, *arguments: object, fits: Callable[[Any], object] = bool) -> Any:
        """Wait until the result of a script fits."""
        end = time.monotonic() + WAIT_S
        while not fits(found := self.run(script, *arguments)):
            if time.monotonic() > end:
                pytest.fail(f"{script!r} still gives {found!r}; the console says {self.console()}")
            time.sleep(_LOOK_S)
        return found

    def texts(self, selector: str) -> list[str]:
        """The texts of all elements for a selector."""
        found: list[str] = self.run(
            "return [...document.querySelectorAll(arguments[0])].map(one => one.textContent)", selector
        )
        return found

    def press(self, selector: str) -> None:
        """Click on the first element."""
        self.wait(
            "const one = document.querySelector(arguments[0]);"
            "one?.dispatchEvent(new MouseEvent('click', {bubbles: true})); return one !== null",
            selector,
        )

    def scheme(self, name: str) -> None:
        """Set the user's color scheme: `light` or `dark`."""
        features = [{"name": "prefers-color-scheme", "value": name}]
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})

    @contextmanager
    def window(self, width: int, height: int) -> Iterator[None]:
        """A window of that size in pixels, as on a phone, until the end of the block."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": True}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        try:
            yield
        finally:
            self.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})

    def console(self) -> list[str]:
        """Messages of the console since the last call."""
        return [f"{line['level']} {line['message']}" for line in self.driver.get_log("browser")]

    def faults(self) -> list[object]:
        """Violations of the rules of accessibility; none without axe-core, which `make axe` fetches."""
        if not AXE.exists():
            return []
        if not self.run("return 'axe' in window"):
            self.run(AXE.read_text())
        found: list[object] = self.driver.execute_async_script(_FAULTS)
        return found

    def picture(self, path: Path) -> None:
        self.driver.save_screenshot(str(path))


@contextmanager
def chromium() -> Iterator[Page]:
    """Start a browser, without a page."""
    browser, driver = need_chromium()
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = browser
    for word in (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--hide-scrollbars",
        f"--window-size={_SIZE[0]},{_SIZE[1]}",
    ):
        options.add_argument(word)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    running = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    running.set_script_timeout(WAIT_S)
    try:
        yield Page(running)
    finally:
        running.quit()
