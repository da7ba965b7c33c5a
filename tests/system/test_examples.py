"""The lesson's talker and listener, and the demo, as users run them."""

import os
import re
import shutil
import signal
from pathlib import Path

import pytest

import bus
from bus.msg.std_msgs import String
from programs import EXAMPLES, assert_nothing_is_left, example, on_one_loop, running

PUBLISHED = re.compile(r'\[INFO\] \[\d{10}\.\d{9}\] \[minimal_publisher\]: Publishing: "Hello World: (\d+)"')
HEARD = re.compile(r'\[INFO\] \[\d{10}\.\d{9}\] \[(listener_[12])\]: I heard: "Hello World: (\d+)"')


# --- the lesson's two programs


@pytest.mark.usefixtures("daemon")
@on_one_loop
async def test_the_talker_obeys_its_arguments_and_ends_quietly(tmp_path: Path) -> None:
    rename = ("--ros-args", "-r", "__node:=other", "-r", "topic:=/somewhere/x")
    async with bus.Node("test", arguments=()) as node:
        subscription = await node.create_subscription(String, "/somewhere/x")
        async with running(tmp_path, EXAMPLES / "talker.py", *rename) as talker:
            texts = [(await subscription.receive())[0].data for _ in range(3)]
            await talker.line('Publishing: "Hello World: 2"')
            talker.process.send_signal(signal.SIGINT)
            assert await talker.end() == -signal.SIGINT
    assert texts == ["Hello World: 0", "Hello World: 1", "Hello World: 2"]
    pattern = r'\[INFO\] \[\d{10}\.\d{9}\] \[other\]: Publishing: "Hello World: \d+"'
    assert all(re.fullmatch(pattern, line) for line in talker.lines)


@pytest.mark.usefixtures("daemon")
@on_one_loop
async def test_the_listener_warns_of_an_empty_message_and_ends_quietly(tmp_path: Path) -> None:
    rename = ("--ros-args", "-r", "__node:=other", "-r", "topic:=x")
    async with bus.Node("test", arguments=()) as node:
        publisher = await node.create_publisher(String, "x")
        async with running(tmp_path, EXAMPLES / "listener.py", *rename) as listener:
            await publisher.wait_for_subscriptions()
            publisher.publish(String())
            publisher.publish(String(data="after it"))
            await listener.line("after it")
            listener.process.send_signal(signal.SIGINT)
            assert await listener.end() == -signal.SIGINT
    warning, info = listener.lines
    assert re.fullmatch(r"\[WARN\] \[\d{10}\.\d{9}\] \[other\]: Received empty message", warning)
    assert re.fullmatch(r'\[INFO\] \[\d{10}\.\d{9}\] \[other\]: I heard: "after it"', info)


# --- the demo


@on_one_loop
async def test_the_demo_ends_by_itself_when_both_listeners_heard_everything(tmp_path: Path) -> None:
    async with running(tmp_path, EXAMPLES / "demo.py", "3") as demo:
        assert await demo.end() == 0, demo.lines
    *lines, verdict = demo.lines
    published: list[str] = []
    heard: dict[str, list[str]] = {"listener_1": [], "listener_2": []}
    for line in lines:
        if said := PUBLISHED.fullmatch(line):
            published.append(said[1])
        else:
            said = HEARD.fullmatch(line)
            assert said, line
            assert said[2] in published, "heard before it was published"
            heard[said[1]].append(said[2])
    assert published == [str(number) for number in range(len(published))]
    assert heard == {"listener_1": published, "listener_2": published}
    assert verdict == f"Both listeners heard all {len(published)} messages."
    assert_nothing_is_left(demo, tmp_path)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@on_one_loop
async def test_a_signal_ends_the_demo_and_leaves_nothing(tmp_path: Path, number: signal.Signals) -> None:
    async with running(tmp_path, EXAMPLES / "demo.py") as demo:
        await demo.line(r"listener_1.*Hello World: 1")
        demo.process.send_signal(number)
        assert await demo.end() == 0
    assert all(PUBLISHED.fullmatch(line) or HEARD.fullmatch(line) for line in demo.lines)
    assert_nothing_is_left(demo, tmp_path)


@on_one_loop
async def test_a_demo_whose_listener_dies_fails_and_says_so(tmp_path: Path) -> None:
    async with running(tmp_path, EXAMPLES / "demo.py", "60") as demo:
        await demo.line(r"listener_2.*Hello World: 0")
        (listener,) = demo.family("__node:=listener_2")
        os.kill(listener, signal.SIGKILL)
        assert await demo.end() == 1
    assert demo.lines[-1] == "The demo failed: listener_2 was ended by SIGKILL."
    assert_nothing_is_left(demo, tmp_path)


@on_one_loop
async def test_a_demo_too_short_for_a_message_fails(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Its talker is slower than any machine."""
    slow = shutil.copytree(EXAMPLES, tmp_path_factory.mktemp("slow") / "examples")
    talker = slow / "talker.py"
    talker.write_text(talker.read_text().replace("create_timer(0.5,", "create_timer(1000.0,"))
    async with running(tmp_path, slow / "demo.py", "0") as demo:
        assert await demo.end() == 1
    assert demo.lines == ["The talker published nothing."]


@pytest.mark.parametrize(
    ("heard", "verdict"),
    [
        (["0", "1", "2"], None),
        (["0", "2"], 'listener_2 did not hear 1 of 3 messages; the first is "1".'),
        (["0", "1", "1", "2"], "listener_2 heard messages twice or out of order: ['0', '1', '1', '2']."),
    ],
)
def test_the_demo_judges_what_was_heard(heard: list[str], verdict: str | None) -> None:
    published = ["0", "1", "2"]
    texts = {"minimal_publisher": published, "listener_1": published, "listener_2": heard}
    assert example("demo").judge(texts) == verdict
