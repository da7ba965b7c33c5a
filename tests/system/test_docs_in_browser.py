"""The site of the pages in a headless Chromium, from files: access, narrow screens, search, no request."""

from collections.abc import Iterator
from typing import Any

import pytest

from browser import Page, chromium, need_chromium
from conftest import WAIT_S
from docsite import build
from vendoring import AXE

pytest.importorskip("selenium", reason="the browser is driven by selenium")

PAGES = ("index", "lesson", "api", "bridge", "qos")
WIDE, NARROW = 1280, 390


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> str:
    return build(tmp_path_factory.mktemp("site")).as_uri()


@pytest.fixture(scope="module")
def browser() -> Iterator[Page]:
    need_chromium()
    with chromium() as page:
        yield page


def resize(page: Page, width: int) -> None:
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


def find_faults(page: Page) -> list[Any]:
    page.run(AXE.read_text())
    page.driver.set_script_timeout(6 * WAIT_S)  # a long page takes seconds, on a busy machine many
    found: list[Any] = page.driver.execute_async_script(
        "const done = arguments[arguments.length - 1];"
        "const runOnly = ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'best-practice'];"
        "axe.run(document, {preload: false, runOnly}).then(result => done(result.violations.map(one =>"
        " [one.id, one.nodes.slice(0, 3).map(node => node.target.join() + ': ' + node.failureSummary)])))"
    )
    return found


@pytest.mark.nightly
def test_access_in_both_palettes_and_on_narrow_screens(site: str, browser: Page) -> None:
    if not AXE.exists():
        pytest.skip("no axe-core: `make axe` fetches it by npm")
    faults = {}
    for width, scheme in ((WIDE, "light"), (WIDE, "dark"), (NARROW, "dark")):
        resize(browser, width)
        browser.scheme(scheme)
        for name in PAGES:
            browser.open(f"{site}/{name}.html")
            browser.wait("return document.querySelector('.md-search[aria-label]') !== null")
            faults[name, width, scheme] = find_faults(browser)
            assert browser.run("return document.scrollingElement.scrollWidth") <= width, (name, width)
            assert browser.console() == []
    assert {where: found for where, found in faults.items() if found} == {}


@pytest.mark.nightly
def test_search_needs_no_server(site: str, browser: Page) -> None:
    resize(browser, WIDE)
    browser.open(f"{site}/index.html")
    browser.wait("return document.querySelector('.md-search[aria-label]') !== null")
    browser.driver.find_element("css selector", ".md-search__input").send_keys("keep_all_window_bytes")
    found = browser.wait(
        "return [...document.querySelectorAll('.md-search-result__link')].map(one => one.href)"
    )
    assert any("configuration.html" in address for address in found)
    loaded = browser.run("return performance.getEntriesByType('resource').map(one => one.name)")
    assert [address for address in loaded if not address.startswith(("file:", "data:"))] == []
