"""`python tests/lookpictures.py`: takes the pictures of docs/look.md again. They show the example robot.

Needs Chromium with its driver, websockets, selenium and textual. Look at each picture afterwards.
"""

import asyncio
import os
import re
import subprocess
import sys
from argparse import Namespace
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from browser import Page, chromium
from bus_cli.stream import open_node
from bus_cli.top.screen import Top
from bus_cli.top.state import State

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / "docs" / "pictures"
LAYERS = ("perception", "cognition", "actuation", "monitoring")
OTHERS = """
import asyncio, bus
from bus.msg.sensor_msgs import Imu, JointState
async def main():
    async with bus.Node("gripper") as gripper, bus.Node("imu_filter") as slow:
        await gripper.create_subscription(JointState, "/joint_states", 10, lambda message: None)
        profile = bus.QoSProfile(2, reliability="best_effort")
        subscription = await slow.create_subscription(Imu, "/imu/data", profile)
        slow.get_logger().warning("the filter takes 20 ms for each message: some are lost")
        while True:
            await subscription.receive()
            await asyncio.sleep(0.02)
bus.run(main())
"""
"""A subscription that matches no publisher, and one that loses messages."""
WIDE, PHONE = (1360, 920), (390, 844)
POINTS = 400
TERMINAL = 140, 18


@contextmanager
def program(*words: str) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen((sys.executable, *words), stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.terminate()


@contextmanager
def robot(folder: Path) -> Iterator[str]:
    """Run busd, the robot and `bus web`; the address of the page."""
    os.environ["BUSD_SOCKET"] = str(folder / "robot.sock")
    with ExitStack() as running:
        for layer in LAYERS:
            running.enter_context(program(str(ROOT / "examples" / "robot" / f"{layer}.py")))
        running.enter_context(program("-c", OTHERS))
        web = running.enter_context(program("-m", "bus_cli", "web", "--listen", "127.0.0.1:0"))
        assert web.stdout is not None
        yield web.stdout.readline().removeprefix("page: ").strip()


def take_page(page: Page, address: str) -> None:
    """The page with a chosen topic and a plot: light, dark, and on a phone."""
    number = '#detail .value[aria-label*="linear_acceleration.{}"]'
    with page.window(*WIDE):
        page.open(address)
        page.press('tr[data-topic="/imu/data"] button')
        for axis in "xy":
            page.press(number.format(axis))
        points = "return Number(document.querySelector('figure.plot')?.dataset.points ?? 0)"
        page.wait(points, fits=lambda number: number > POINTS)
        page.run("scrollTo(0, 0)")
        for scheme in ("light", "dark"):
            page.scheme(scheme)
            page.picture(PICTURES / f"page-{scheme}.png")
    page.scheme("light")
    with page.window(*PHONE):
        page.open(address)
        page.press('tr[data-topic="/imu/data"] button')
        page.wait("return document.querySelectorAll('#detail .bursts li').length")
        page.picture(PICTURES / "page-phone.png")
    page.open("about:blank")


async def draw_top() -> str:
    """The screen of `bus top` as SVG, with the topic selected that loses messages."""
    async with open_node(Namespace(socket=None, domain=None)) as node:
        top = Top(node, 1.0, State())
        async with top.run_test(size=TERMINAL) as pilot:
            await asyncio.sleep(12)  # as long as a line of bars
            await pilot.press("down", "down", "down", "down")
            await pilot.pause(1.5)
            return top.export_screenshot(title="bus top")


def take_top(page: Page, folder: Path) -> None:
    drawing = asyncio.run(draw_top())
    file = folder / "top.svg"
    file.write_text(drawing)
    found = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', drawing)
    assert found is not None
    width, height = (int(float(size)) for size in found.groups())
    with page.window(width, height):
        page.open(file.as_uri())
        page.picture(PICTURES / "top.png")


def main() -> None:
    with TemporaryDirectory(prefix="busd-") as name, robot(Path(name)) as address, chromium() as page:
        take_page(page, address)
        take_top(page, Path(name))


if __name__ == "__main__":
    main()
