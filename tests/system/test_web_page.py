"""The page in a headless Chromium: graph, values, plots, losses, a restart, the keyboard, access."""

import os
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from browser import Page, chromium, need_chromium
from bus.graph import GraphEndpoint
from cli import LISTENER, TALKER, Running, bus, script, wait_for_graph
from conftest import Daemon
from programs import EXAMPLES
from vendoring import AXE

pytest.importorskip("websockets", reason="the page's server is made of websockets")
pytest.importorskip("selenium", reason="the browser is driven by selenium")

from web_clients import LOSER, Serving, serving

ROBOT = ("perception", "cognition", "actuation", "monitoring")
TOPICS = {"/camera/image_raw", "/imu/data", "/joint_states", "/cmd_vel", "/cmd_vel_applied", "/health"}
LAYOUTS = Path(__file__).parents[1] / "graph_layouts.js"
NUMBER = '#detail .value[aria-label*="linear_acceleration.x"]'
CROWD = """
import asyncio, sys, bus
from contextlib import AsyncExitStack
from bus.msg.std_msgs import String
async def main():
    async with AsyncExitStack() as nodes:
        for number in range(200):
            node = await nodes.enter_async_context(bus.Node(f"node_{number}", rosout=False))
            for topic in range(5):
                await node.create_publisher(String, f"topic_{number * 5 + topic}", 10)
            await node.create_subscription(String, f"topic_{(number * 5 + 7) % 1000}", 10)
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""
NUMBERS = TALKER.replace('f"Hello World: {number}"', "number").replace("String", "Int64")
PICTURE = """
import asyncio, bus, struct, zlib
from bus.msg.sensor_msgs import CompressedImage
def part(kind, data):
    return struct.pack("!I", len(data)) + kind + data + struct.pack("!I", zlib.crc32(kind + data))
png = b"".join([
    bytes([137, 80, 78, 71, 13, 10, 26, 10]), part(b"IHDR", struct.pack("!IIBBBBB", 3, 2, 8, 0, 0, 0, 0)),
    part(b"IDAT", zlib.compress(bytes(8))), part(b"IEND", b""),
])
async def main():
    async with bus.Node("camera") as node:
        publisher = await node.create_publisher(CompressedImage, "image", 1)
        print("ready", flush=True)
        while True:
            publisher.publish(CompressedImage(format="png", data=png))
            await asyncio.sleep(0.1)
bus.run(main())
"""
HOSTILE = """
import asyncio, bus
from bus.msg.std_msgs import String
TEXT = "<img src=x onerror='document.title=1'><script>document.title=2</script>"
async def main():
    async with bus.Node("hostile") as node:
        publisher = await node.create_publisher(String, "topic", 10)
        print("ready", flush=True)
        while True:
            publisher.publish(String(data=TEXT))
            node.get_logger().error(TEXT)
            await asyncio.sleep(0.1)
bus.run(main())
"""

SPIKES = """
import bus, itertools
from bus.msg.geometry_msgs import Point
async def main():
    async with bus.Node("spikes") as node:
        publisher = await node.create_publisher(Point, "topic", 10)
        print("ready", flush=True)
        numbers = itertools.count()
        node.create_timer(0.005, lambda: publisher.publish(Point(x=0.0 if next(numbers) % 19 else 1000.0)))
        await node.spin()
bus.run(main())
"""
"""200 messages a second, of which every nineteenth is larger: a page shows 20 of them."""


IS_SEEN = """
const around = document.querySelector("#graph").getBoundingClientRect(), box = one.getBoundingClientRect();
return box.left >= around.left && box.right <= around.right
  && box.top >= around.top && box.bottom <= around.bottom;
"""
SEEN = f"const one = document.querySelector(arguments[0]); if (!one) return false; {IS_SEEN}"
"""Whether a box of the graph is in the part that has been scrolled to."""


LEFTMOST = """
const draw = CanvasRenderingContext2D.prototype.fillText;
window.lefts = {};
CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
  if (this.textAlign === "right") window.lefts[text] = x - this.measureText(text).width;
  draw.call(this, text, x, y);
};
"""
"""Notes where each label of a plot's left axis begins."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Page]:
    need_chromium()
    with chromium() as page:
        yield page


@pytest.fixture
def page(browser: Page) -> Iterator[Page]:
    """At the end its console must be empty, except for errors about a server that a test has stopped."""
    browser.console()
    yield browser
    browser.open("about:blank")
    assert browser.console() == []


@pytest.fixture
def server(daemon: Daemon) -> Iterator[Serving]:
    with serving() as server:
        yield server


@pytest.fixture
def robot(daemon: Daemon) -> Iterator[None]:
    """The robot's four layers, on the test's busd."""
    with ExitStack() as layers:
        for layer in ROBOT:
            layers.enter_context(Running((str(EXAMPLES / "robot" / f"{layer}.py"),)))
        wait_for_graph(lambda graph: graph.topics().keys() >= TOPICS and len(graph.matches) > 8)
        yield


def names(page: Page, kind: str) -> set[str]:
    found: list[str] = page.run(
        "return [...document.querySelectorAll(`g.${arguments[0]}`)].map(one => one.dataset[arguments[0]])",
        kind,
    )
    return set(found)


def choose(page: Page, topic: str) -> None:
    page.press(f'g.topic[data-topic="{topic}"]')
    page.wait(f"return document.getElementById('detail-title').textContent === '{topic}'")


def cell(column: str) -> str:
    """A script: the text of the cell of /topic in that column."""
    return f'return document.querySelector(\'tr[data-topic="/topic"] [data-column="{column}"]\').textContent'


def test_the_robot(robot: None, server: Serving, page: Page) -> None:
    page.open(server.page)
    page.wait("return document.querySelectorAll('g.topic').length", fits=lambda count: count >= len(TOPICS))
    assert page.driver.current_url == f"http://{server.host}:{server.port}/", "the token has left the address"
    graph = wait_for_graph(lambda graph: graph.matches)
    assert names(page, "node") == {f"/{layer}" for layer in ROBOT}
    assert names(page, "topic") == TOPICS
    drawn = page.run("return [...document.querySelectorAll('g.edge')].map(one => one.dataset.edge)")
    ends = {
        f"{end.kind} {end.topic}": 0
        for end in (*graph.publishers, *graph.subscriptions)
        if end.topic in TOPICS and not end.node.name.startswith("_")
    }
    assert set(drawn) == ends.keys()
    choose(page, "/imu/data")
    before = page.wait(f"return document.querySelector('{NUMBER}')?.textContent")
    page.wait(f"return document.querySelector('{NUMBER}').textContent", fits=lambda text: text != before)
    page.press(NUMBER)
    page.wait("return document.querySelector('figure.plot')?.dataset.points", fits=lambda n: int(n or 0) > 20)
    assert page.run("return document.querySelector('figure.plot canvas') !== null")
    page.press('tr[data-topic="/camera/image_raw"] button')
    size = page.wait(
        "const one = document.querySelector('#detail canvas'); return one && [one.width, one.height]"
    )
    assert 10 < size[0] <= 240
    page.press('g.node[data-node="/perception"]')
    page.wait("return document.querySelectorAll('#detail .ends li').length", fits=lambda count: count == 5)
    assert set(page.texts("#detail .ends .name")) == {*TOPICS, "/rosout"} - {"/cmd_vel", "/health"}
    assert page.run("return document.querySelectorAll('g.edge.near').length") == 4
    page.press("#detail .ends .name")
    page.wait("return document.querySelector('#detail .values') !== null")
    page.press("#pause")
    frozen = page.run("return document.getElementById('value-note').textContent")
    page.wait("return document.querySelector('figure.plot') !== null")
    assert page.run("return document.getElementById('value-note').textContent") == frozen
    page.press("#pause")
    page.wait("return document.getElementById('value-note').textContent", fits=lambda text: text != frozen)


@pytest.mark.landing
def test_a_plot_shows_each_spike(server: Serving, page: Page) -> None:
    """Also those of messages between the values that are shown."""
    with script(SPIKES):
        page.open(server.page)
        choose(page, "/topic")
        page.run(
            "const Real = uPlot; window.uPlot = function (...a) { return window.drawn = new Real(...a); }"
        )
        page.press('#detail .value[aria-label^="x "]')
        spikes = page.wait(
            "const [times, values] = window.drawn?.data ?? [[], []];"
            "return times.filter((_, at) => values[at] === 1000)",
            fits=lambda found: len(found) >= 30,
        )
    apart_s = sorted(later - before for before, later in pairwise(spikes))
    assert apart_s[0] > 0
    assert apart_s[len(apart_s) // 2] < 0.2, "ten a second; of the values shown one in nineteen is larger"


def test_what_a_subscription_loses_is_red_and_counted(server: Serving, page: Page) -> None:
    edge = 'g.edge[data-edge="subscription /topic"]'
    height = "return document.querySelector('tr[data-topic=\"/topic\"]')?.offsetHeight"
    with script(LOSER):
        page.open(server.page)
        before = page.wait(height)
        with script(TALKER, "0.002"):
            page.wait(f"return document.querySelector('{edge}')?.classList.contains('losing')")
            page.wait("return document.querySelector('tr.losing .strip').getAttribute('d')")
            assert page.run(height) == before, "bars of losses move no row"
            line = f"getComputedStyle(document.querySelector('{edge} path')).stroke"
            assert page.run(f"return {line}") == "rgb(179, 20, 11)"
            page.wait(cell("Why"), fits=lambda text: text == "now: replaced")
            assert page.run(cell("Queue")).endswith("/2")
        page.wait(cell("Why"), fits=lambda text: text == "replaced")

        def lost() -> str:
            info = bus("topic", "info", "-v", "/topic").out
            number = info.partition("Endpoint type: SUBSCRIPTION")[2].partition("Dropped: ")[2].split()[0]
            return f"{int(number):,}".replace(",", "\N{NO-BREAK SPACE}")

        shown = (
            "return document.querySelector('g.label[data-edge=\"subscription /topic\"] text')?.textContent"
        )
        page.wait(shown, fits=lambda text: text == f"lost {lost()}")
        page.wait(cell("Lost"), fits=lambda text: text == lost())


def _has_lost(one: GraphEndpoint) -> bool:
    return one.statistics is not None and bool(one.statistics.dropped)


def test_losses_have_a_past_that_survives_a_restart_of_busd(
    daemon: Daemon, server: Serving, page: Page
) -> None:
    row = "document.querySelector('tr[data-topic=\"/topic\"]')"
    strip = f"{row}?.querySelector('.strip')?.getAttribute('d')"
    number = "querySelector('[data-column=\"Lost\"]').textContent.replaceAll('\\u00a0', '')"
    lost = f"return Number({row}?.{number} ?? -1)"
    with script(LOSER.replace("String", "Int64")):
        page.open(server.page)
        with script(NUMBERS, "0.01"):
            page.wait(f"return {strip}")
            choose(page, "/topic")
            page.wait("return document.querySelector('#detail .bursts li')?.textContent.includes('replaced')")
            assert page.run("return document.querySelector('#detail .past path').getAttribute('d')")
            label = f"{row}.querySelector('.spark').getAttribute('aria-label')"
            assert "lost" in page.run(f"return {label}")
            page.wait("return document.querySelector('#detail .ends .strip[d^=M]')?.getAttribute('d')")
            mine = "document.querySelector('#detail .ends svg:not([hidden])')"
            assert "lost in the last minute" in page.run(f"return {mine}.getAttribute('aria-label')")
            page.wait("return document.querySelector('#detail .ages path')?.getAttribute('d')")
            page.press("#detail .value")
            drawn = "return Number(document.querySelector('figure.plot')?.dataset.lost ?? 0)"
            page.wait(drawn, fits=lambda number: number > 0)
        page.wait(f"return !{row}.classList.contains('losing')")
        before = page.run(lost)
        assert before > 0
        page.run(
            f"""window.least = Infinity; window.wasLosing = false;
            const see = () => {{ const one = {row}; if (one) {{
                const shown = Number(one.{number});
                window.least = Math.min(window.least, shown);
                window.wasLosing ||= one.classList.contains('losing'); }} }};
            const all = {{ subtree: true, childList: true, attributes: true, characterData: true }};
            new MutationObserver(see).observe(document.body, all)"""
        )
        daemon.kill()
        page.wait("return document.getElementById('state').textContent.includes('busd is away')")
        daemon.restart()
        page.wait("return document.getElementById('state').textContent.startsWith('on ')")
        page.wait(lost, fits=lambda now: now == before)
        wait_for_graph(lambda graph: any(map(_has_lost, graph.subscriptions_of("/topic"))))
        assert "replaced" in page.texts("#detail .bursts li")[0]
        page.wait("return performance.now() > arguments[0]", page.run("return performance.now()") + 1500)
        assert page.run("return [window.least, window.wasLosing]") == [before, False]


def test_routes_and_what_does_not_match(
    daemon: Daemon, server: Serving, page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BUS_ROUTE", "socket")
    other = LISTENER.replace("String", "Int32").replace("minimal_subscriber", "other")
    with script(TALKER, "0.01"), script(LISTENER), script(other):
        page.open(server.page)
        edges = "[...document.querySelectorAll('g.edge[data-edge=\"subscription /topic\"]')]"
        page.wait(f"return {edges}.length", fits=lambda count: count == 2)
        kinds = page.run(f"return {edges}.map(one => [...one.classList].join()).sort()")
        assert kinds == ["edge,grey", "edge,socket"]
        line = f"{edges}.find(one => one.matches('.socket')).querySelector('path')"
        assert page.run(f"return getComputedStyle({line}).strokeDasharray") == "7px, 4px"
        texts = page.texts('g.label[data-edge="subscription /topic"] text')
        assert sorted(texts) == ["", "no match"]
        assert page.texts('tr[data-topic="/topic"] [data-column="Why"]') == ["no match"]
        choose(page, "/topic")
        page.wait("return document.querySelectorAll('.mismatches li').length", fits=lambda count: count == 1)
        assert page.texts(".mismatches li") == [
            "/minimal_publisher and /other don't match: the publisher has std_msgs/msg/String, "
            "the subscription std_msgs/msg/Int32"
        ]


def test_all_stands_still_but_what_the_user_does(server: Serving, page: Page) -> None:
    with script(HOSTILE), script(TALKER.replace('"topic"', '"other"'), "0.01"):
        page.open(server.page)
        page.wait("return document.querySelectorAll('tbody tr').length", fits=lambda count: count == 3)
        lines = "return document.querySelectorAll('#lines li').length"
        page.wait(lines)
        page.press("#pause")
        shown = page.run(lines)
        choose(page, "/other")
        page.wait("return document.querySelectorAll('#detail .ends li').length")
        page.wait("return performance.now() > arguments[0]", page.run("return performance.now()") + 1000)
        assert page.run(lines) == shown, "ten a second have come"
        assert page.texts("#value-note") == ["no message yet"]
        page.press("#pause")
        page.wait(lines, fits=lambda count: count >= shown + 5)
        page.wait("return document.querySelector('#detail .text') !== null")


def test_a_compressed_image_is_drawn(server: Serving, page: Page) -> None:
    with script(PICTURE):
        page.open(server.page)
        page.wait("return document.querySelector('g.topic') !== null")
        choose(page, "/image")
        size = "const one = document.querySelector('#detail canvas'); return one && [one.width, one.height]"
        page.wait(size, fits=lambda found: found == [3, 2])


def test_busd_is_restarted_and_the_page_comes_back(daemon: Daemon, server: Serving, page: Page) -> None:
    number = "return Number(document.querySelector('#detail .text')?.textContent.split(' ')[2] ?? 0)"
    with script(LISTENER), script(TALKER, "0.01"):
        page.open(server.page)
        page.wait("return document.querySelector('g.topic') !== null")
        choose(page, "/topic")
        before = page.wait(number)
        daemon.kill()
        page.wait("return document.getElementById('state').textContent.includes('busd is away')")
        daemon.restart()
        page.wait("return document.getElementById('state').textContent.startsWith('on ')")
        page.wait(number, fits=lambda now: now > before)
        page.wait("return document.querySelectorAll('g.edge').length", fits=lambda count: count == 2)


def test_texts_of_strangers_are_texts(server: Serving, page: Page) -> None:
    with script(HOSTILE):
        page.open(server.page)
        page.wait("return document.querySelector('g.topic') !== null")
        choose(page, "/topic")
        page.wait("return document.querySelector('#detail .text')?.textContent.startsWith('<img')")
        page.wait("return document.querySelector('#lines li')?.textContent.includes('<script>')")
        assert (
            page.run("return document.querySelectorAll('#detail img, #lines img, main script').length") == 0
        )
        assert page.run("return document.title").startswith("bus ")


def test_by_the_keyboard_alone(server: Serving, page: Page) -> None:
    """Tab to the row, Enter, Tab to a number, Enter: the focus stays although rows are updated."""
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    def press(key: str) -> None:
        ActionChains(page.driver).send_keys(key).perform()

    focus = "return document.activeElement.matches(arguments[0])"
    with script(NUMBERS, "0.01"):
        page.open(server.page)
        page.wait("return document.querySelector('tbody button') !== null")
        seen: list[Any] = []
        for wanted in ("g.topic", 'tr[data-topic="/topic"] button'):
            for _ in range(40):
                press(Keys.TAB)
                if page.run(focus, wanted):
                    break
            assert page.run(focus, wanted), wanted
            seen.append(page.run("return document.activeElement.getAttribute('aria-label')"))
        assert "topic /topic" in seen[0]
        press(Keys.ENTER)
        page.wait("return document.querySelector('#detail .value') !== null")
        value = "return document.querySelector('#detail .value').textContent"
        for _ in range(10):
            first = page.run(value)
            page.wait(value, fits=lambda text, first=first: text != first)
        assert page.run(focus, 'tr[data-topic="/topic"] button')
        for _ in range(40):
            press(Keys.TAB)
            if page.run(focus, "#detail .value"):
                break
        press(Keys.SPACE)
        page.wait(
            "return document.querySelector('figure.plot')?.dataset.points", fits=lambda n: int(n or 0) > 3
        )
        assert page.run(focus, '#detail .value[aria-pressed="true"]')
        assert page.run("return getComputedStyle(document.activeElement).outlineWidth") == "2px"


@pytest.mark.parametrize("focused", ['g.topic[data-topic="/topic"]', 'tr[data-topic="/topic"] button'])
def test_the_focus_stays_while_topics_come_and_go(server: Serving, page: Page, focused: str) -> None:
    with script(NUMBERS, "0.01"):
        page.open(server.page)
        page.wait("const one = document.querySelector(arguments[0]); one?.focus(); return one", focused)
        row = "return document.querySelector(`tr[data-topic='/${arguments[0]}']`)"
        for other in ("aa_one", "zz_one"):
            with script(TALKER.replace('"topic"', f'"{other}"'), "0.01"):
                page.wait(row, other)
                assert page.run("return document.activeElement.matches(arguments[0])", focused)
            page.wait(row, other, fits=lambda found: found is None)
            assert page.run("return document.activeElement.matches(arguments[0])", focused), other


def test_numbers_are_whole(server: Serving, page: Page) -> None:
    long = NUMBERS.replace("range(1, 1_000_000)", "range(1_796_157_551, 1_797_000_000)")
    with script(long, "0.01"):
        page.open(server.page)
        choose(page, "/topic")
        page.run(LEFTMOST)
        page.press("#detail .value")
        page.wait("return document.querySelector('figure.plot')?.dataset.points > 20")
        lefts = page.run("return window.lefts")
    assert any(label.startswith("1\N{NO-BREAK SPACE}796\N{NO-BREAK SPACE}157") for label in lefts)
    assert min(lefts.values()) >= 0
    written = page.driver.execute_async_script(
        "const done = arguments[0], numbers = [0.00025, -1.5, 1e-9, 2 ** 53, 1e300];"
        "import('/format.js').then(({hertz, tick}) => done([hertz(12), hertz(1234), ...numbers.map(tick)]))"
    )
    assert written[:2] == ["12.0 Hz", "1.23 kHz"]
    assert written[2:] == ["0.00025", "-1.5", "1e-9", "9.007199254740992e+15", "1e+300"]


def test_the_seventeenth_page_says_the_reason(server: Serving, page: Page) -> None:
    state = "return document.getElementById('state').textContent"
    with ExitStack() as others:
        for _ in range(16):
            others.enter_context(server.viewer())
        page.open(server.page)
        page.wait(state, fits=lambda text: "16 clients are connected" in text)
    page.wait(state, fits=lambda text: text.startswith("on "))


def test_two_hundred_nodes_and_a_thousand_topics(server: Serving, page: Page) -> None:
    with script(CROWD):
        page.open(server.page)
        page.wait("return document.querySelectorAll('tbody tr').length", fits=lambda count: count == 100)
        boxes = page.wait("return document.querySelectorAll('g.topic, g.node').length")
        assert 10 < boxes <= 80
        assert "shown are the 80 around" in page.texts("#graph-note")[0]
        assert page.texts("#pages span") == [" page 1 of 10 "]
        assert page.faults() == []
        page.press('tr[data-topic="/topic_143"] button')
        page.wait(SEEN, "g.topic.chosen")
        assert page.run("return document.querySelector('.map').checkVisibility()"), "only a part is in sight"
        page.run("document.querySelector('#graph').scrollTo(0, 0)")
        assert not page.run(SEEN, "g.topic.chosen"), "the user may scroll away"
        page.press('.zoom button[title^="Fit"]')
        page.wait(f"return [...document.querySelectorAll('g.topic, g.node')].every(one => {{ {IS_SEEN} }})")
        assert not page.run("return document.querySelector('.map').checkVisibility()")
        page.press('.zoom button[title^="Larger"]')
        page.wait("return document.querySelector('.map').checkVisibility()")
        page.run("document.getElementById('filter').value = 'topic_77';"
                 "document.getElementById('filter').dispatchEvent(new Event('input'))")  # fmt: skip
        page.wait("return document.querySelectorAll('tbody tr').length", fits=lambda count: count == 11)


def test_access_and_looks(robot: None, server: Serving, page: Page, tmp_path: Path) -> None:
    """axe finds no violations, and the pictures are those of docs/look.md (BUSD_PICTURES is their folder)."""
    if not AXE.exists():
        pytest.skip("no axe-core: `make axe` fetches it by npm")
    with script(TALKER, "0.002"), script(LOSER):
        page.open(server.page)
        page.wait("return document.querySelectorAll('g.topic').length", fits=lambda n: n >= len(TOPICS))
        choose(page, "/imu/data")
        page.press(NUMBER)
        page.press(NUMBER.replace("acceleration.x", "acceleration.y"))
        page.wait("return document.querySelector('g.edge.losing') !== null")
        page.wait(
            "return document.querySelector('figure.plot')?.dataset.points", fits=lambda n: int(n or 0) > 60
        )
        folder = Path(os.environ.get("BUSD_PICTURES", tmp_path))
        found = {}
        for scheme in ("light", "dark"):
            page.scheme(scheme)
            page.picture(folder / f"look-{scheme}.png")
            found[scheme] = page.faults()
        with page.window(390, 844):
            page.picture(folder / "look-phone.png")
            found["phone"] = page.faults()
        page.scheme("light")
        assert found == {"light": [], "dark": [], "phone": []}


def test_another_start_asks_for_its_address(daemon: Daemon, page: Page) -> None:
    with serving() as server:
        page.open(server.page)
        page.wait("return document.getElementById('state').textContent.startsWith('on ')")
    page.wait("return document.getElementById('state').textContent.includes('away')")
    with serving("--listen", f"127.0.0.1:{server.port}"):
        page.wait("return document.getElementById('state').textContent.includes('has restarted')")
    page.open("about:blank")
    assert all("403" in line or "refused" in line.lower() or "ERR_" in line for line in page.console())


def test_a_phone(server: Serving, page: Page) -> None:
    """Its 390 pixels show the columns about losses. The details are a sheet that hides nothing for good."""
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    def press(key: str) -> None:
        ActionChains(page.driver).send_keys(key).perform()

    row = 'tr[data-topic="/topic"] button'
    focus = "return document.activeElement.matches(arguments[0])"
    place = "const {left, top, right, bottom} = document.querySelector(arguments[0]).getBoundingClientRect();"
    with script(LOSER), script(TALKER, "0.002"), page.window(390, 844):
        page.open(server.page)
        page.wait("return document.querySelector('tr.losing') !== null")
        for column in ("Topic", "Hz", "Lost", "Why", "Lost/s"):
            right = page.run(f"{place} return right", f'th[data-column="{column}"]')
            assert right <= 390, column
        assert page.run("return document.documentElement.scrollWidth") == 390
        assert page.texts("#log-empty") == ["No lines yet: nodes' log lines (/rosout) appear here."]
        below = page.run(
            f"{place} return document.documentElement.scrollHeight - scrollY - bottom", "section.log"
        )
        assert 0 <= below < 30, "the log fills the rest of the window"
        assert not page.run("return document.getElementById('sheet').checkVisibility()")
        page.run("document.querySelector(arguments[0]).focus()", row)
        press(Keys.ENTER)
        page.wait(focus, "#detail-title")
        page.wait(
            "return document.querySelectorAll('#detail .ends li').length", fits=lambda count: count == 2
        )
        top, bottom = page.run(f"{place} return [top, bottom]", "#sheet")
        assert 844 / 3 < top < 844 * 0.6
        assert bottom == 844
        assert page.run(f"{place} return bottom", row) <= top, "the chosen row stays in sight"
        page.run("const sheet = document.getElementById('sheet'); sheet.scrollTo(0, sheet.scrollHeight)")
        assert page.run(f"{place} return top", "#detail .title button") >= top, "it can always be closed"
        page.run("document.getElementById('severity').focus()")
        assert page.run(f"{place} return bottom", "#severity") <= top, "no focus below the sheet"
        page.run("document.querySelector(arguments[0]).focus()", "#detail .values")
        press(Keys.ESCAPE)
        page.wait("return !document.getElementById('sheet').checkVisibility()")
        assert page.run(focus, row)
        press(Keys.ENTER)
        page.wait(focus, "#detail-title")
        press(Keys.TAB)
        press(Keys.ENTER)  # Close
        page.wait("return !document.getElementById('sheet').checkVisibility()")
        assert page.run(focus, row)


def test_a_phone_breaks_long_names(server: Serving, page: Page) -> None:
    name = 25 * "long"
    crowd = CROWD.replace("range(200)", "range(20)").replace("topic_", f"{name}_")
    with script(crowd), script(HOSTILE.replace('"hostile"', f'"{name}"')), page.window(390, 844):
        page.open(server.page)
        page.wait("return document.getElementById('graph-note').textContent.includes('shown are the 80')")
        page.press("tbody button")
        page.wait(
            "return document.querySelector('#detail .title button')?.getBoundingClientRect().right <= 390"
        )
        page.wait("return document.querySelector('#lines li') !== null")
        for place in ("html", "#lines", "#detail"):
            wide = (
                "const one = document.querySelector(arguments[0]); return one.scrollWidth - one.clientWidth"
            )
            assert page.run(wide, place) == 0, place


def test_lines_cross_no_label_and_no_box(server: Serving, page: Page) -> None:
    """In twenty graphs with circles, lines over many columns, and labels of several widths."""
    page.open(server.page)
    page.wait("return document.getElementById('graph-note').textContent")
    assert page.texts("#graph-note") == ["No nodes are on the bus."]
    assert page.driver.execute_async_script(LAYOUTS.read_text()) == []
