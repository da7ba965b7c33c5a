"""`bus doctor --conformance`: right clients pass all stories, and each mistake is found by its story."""

import asyncio
import os
import re
import sys
from pathlib import Path

import pytest

from bus_cli.doctor.conformance import client
from bus_cli.doctor.conformance.options import NAMES
from bus_cli.doctor.conformance.program import outcome
from bus_cli.doctor.conformance.stories import STORIES
from cli import bus
from conftest import SOON_S
from effort import is_nightly
from programs import EXAMPLES, on_one_loop
from wrong_clients import WAYS

TESTS = Path(__file__).parents[1]
BARE = (sys.executable, str(EXAMPLES / "bare_client.py"))
WRONG = (sys.executable, str(TESTS / "wrong_clients.py"))
RIGHT = {
    "window": [sys.executable, str(TESTS / "lossless_client.py"), "talk"],
    **{story: [sys.executable, str(TESTS / "service_clients.py"), story] for story in ("serve", "call")},
}
"""The clients for stories about services, and about keep all."""
AT_ONCE = 4


@pytest.fixture(autouse=True)
def no_other_busd(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUSD_AUTOSTART", "0")


async def play(stories: list[tuple[str, list[str]]]) -> list[tuple[str, str]]:
    """Mark and text of each story with its client."""
    places = asyncio.Semaphore(AT_ONCE)

    async def one(story: str, command: list[str]) -> tuple[str, str]:
        async with places:
            found = await outcome(story, command, SOON_S)
            return found.mark, found.text

    return await asyncio.gather(*(one(story, command) for story, command in stories))


@on_one_loop
async def test_a_right_client_passes_every_story() -> None:
    played = [(story, RIGHT.get(story, [*BARE, "relay"])) for story in STORIES]
    outcomes = dict(zip(STORIES, await play(played), strict=True))
    assert {text for mark, text in outcomes.values() if mark != "ok"} == set()
    assert outcomes["subscribe"][1] == "/conformance/in: 3 samples returned on /conformance/out"
    declared = "node /bare_relay, subscription 42 on /conformance/in (std_msgs/msg/String), publisher 44 on "
    assert outcomes["declare"][1].startswith(declared)
    assert outcomes["restart"][1] == "connected and declared again, 2 endpoints with the same gids"
    assert outcomes["events"][1] == "/conformance/in: 4 samples returned on /conformance/out"
    assert outcomes["fault"][1].startswith("connected again after a Fault with `again` at its start")
    assert outcomes["window"][1] == "/topic: never more than 3 samples without credit"
    assert outcomes["limit"][1] == "/conformance/out: no message above the limit of 200 bytes"
    returned = "5 samples returned by socket and socket; texts of up to 1000000 bytes"
    assert outcomes["growth"][1] == returned
    assert outcomes["serve"][1] == "/add: 2 calls answered, 2 questions too"
    assert outcomes["call"][1] == "/add: asked about call 1 until it knew that the call was lost"


@on_one_loop
async def test_stories_without_an_occasion_are_left_out() -> None:
    played = [(story, [*BARE, role]) for role in ("talk", "listen") for story in ("publish", "subscribe")]
    assert await play(played) == [
        ("ok", "3 samples on /topic"),
        ("-", "left out: it has no subscription"),
        ("-", "left out: it has no publisher"),
        ("ok", "/topic: 3 samples sent"),
    ]
    assert await play([(story, [*BARE, "talk"]) for story in RIGHT]) == [
        ("-", "left out: it has no publisher that is reliable and keep all"),
        ("-", "left out: it serves no service"),
        ("-", "left out: it is no client of a service"),
    ]
    assert await play([(story, [*BARE, "talk"]) for story in ("limit", "growth")]) == [
        ("-", "left out: it does not publish on /conformance/out the messages of /conformance/in"),
        ("-", "left out: it has no subscription to a type with a text"),
    ]


@on_one_loop
async def test_a_lossless_relay_shows_that_it_acknowledges() -> None:
    relay = [sys.executable, str(TESTS / "lossless_client.py"), "relay"]
    text = "/conformance/in: 3 samples returned on /conformance/out, 3 samples acknowledged"
    assert await play([("subscribe", relay)]) == [("ok", text)]


@on_one_loop
async def test_a_transient_local_talker_sends_its_history_again() -> None:
    latched = [sys.executable, str(TESTS / "latched_client.py"), "talk"]
    outcomes = await play([(story, latched) for story in ("fault", "restart", "real")])
    assert [mark for mark, _ in outcomes] == ["ok"] * 3, outcomes


@pytest.mark.parametrize(
    ("story", "way", "role", "place"),
    [
        ("declare", "OtherHash", "talk", 'docs/protocol.md, "Types and payloads"'),
        ("publish", "OtherByteOrder", "talk", 'docs/protocol.md, "Frames"'),
        ("subscribe", "NoAck", "relay", 'docs/protocol.md, "Keep all"'),
        ("serve", "LateReplies", "serve", 'docs/services.md, "On the bus"'),
    ],
)
@on_one_loop
async def test_the_section_to_read(story: str, way: str, role: str, place: str) -> None:
    found = await outcome(story, [*WRONG, way, role], SOON_S)
    assert (found.mark, found.place) == ("fail", place)
    page, section = re.fullmatch(r'(\S+), "(.*)"', place).groups()  # type: ignore[union-attr]
    assert f"# {section}\n" in (TESTS.parent / page).read_text()


@on_one_loop
async def test_a_client_with_services_only() -> None:
    stories = ("declare", "refusal", "fault", "real", "growth")
    outcomes = await play([(story, RIGHT[role]) for role in ("serve", "call") for story in stories])
    declared = "node /bare_serve, server of /add (example_interfaces/srv/AddTwoInts)"
    fault = "connected again after a Fault with `again` at its start, and after another one later"
    left_out = "-", "left out: it has only services"
    found = [left_out, ("ok", fault), left_out, left_out]
    assert outcomes == [
        ("ok", declared),
        *found,
        ("ok", declared.replace("serve", "call", 1).replace("server", "client")),
        *found,
    ]


@pytest.mark.nightly
@on_one_loop
async def test_the_library_itself_passes() -> None:
    played_names = [(name, story) for name in ("talker", "listener") for story in STORIES]
    played = [(story, [sys.executable, str(EXAMPLES / f"{name}.py")]) for name, story in played_names]
    outcomes = await play(played)
    assert [text for mark, text in outcomes if mark == "fail"] == []
    marks = dict(zip(played_names, (mark for mark, _ in outcomes), strict=True))
    assert {name for name, mark in marks.items() if mark == "-"} == {
        *((name, story) for name in ("talker", "listener") for story in (*RIGHT, "limit")),
        *(("talker", "subscribe"), ("talker", "growth"), ("listener", "publish")),
    }


@pytest.mark.landing
@on_one_loop
async def test_each_mistake_is_found_by_its_story() -> None:
    """Daily only the first mistake of each story, and both about frames that are cut."""
    first = {way.story: way for way in reversed(WAYS)}
    ways = [way for way in WAYS if is_nightly() or way.story == "split" or way is first[way.story]]
    outcomes = await play([(way.story, [*WRONG, way.client.__name__, way.role]) for way in ways])
    unfound = [
        (way.client.__name__, mark, text)
        for way, (mark, text) in zip(ways, outcomes, strict=True)
        if mark != "fail" or not way.is_found_by(text)
    ]
    assert unfound == []


@on_one_loop
async def test_no_client_survives_its_story(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "_END_S", 0.1)
    code = (
        "import os, pathlib, signal, sys; signal.signal(signal.SIGTERM, signal.SIG_IGN); "
        "pathlib.Path(sys.argv[1]).write_text(str(os.getpid())); print('ready', flush=True); signal.pause()"
    )
    place = tmp_path / "pid"
    found = await outcome("hello", [sys.executable, "-c", code, str(place)], 1.0)
    assert found[:2] == ("fail", "it did not connect within 1 s to the socket in BUSD_SOCKET")
    assert found.output == "ready\n"
    with pytest.raises(ProcessLookupError):
        os.kill(int(place.read_text()), 0)


def test_every_story_finds_a_mistake() -> None:
    assert tuple(STORIES) == NAMES
    assert {way.story for way in WAYS} == set(NAMES)


def test_the_program() -> None:
    result = bus("doctor", "--conformance", "--story", "hello", "--", *BARE, "talk")
    assert result.out == "[ ok ] hello: version 1, program 'bare_client.py'\n\n1 story passed\n"
    assert (result.code, result.err) == (0, "")


def test_a_mistake_is_shown_with_the_last_lines_of_the_client_and_the_section() -> None:
    command = (*WRONG, "HappyRefusal", "talk")
    result = bus("doctor", "--conformance", "--story", "refusal", "--", *command)
    assert result.code == 1
    assert result.out == (
        "[fail] refusal: it ended with status 0, as if nothing was refused\n"
        "       | this busd refuses the endpoint, to test its client\n"
        '       -> docs/protocol.md, "Errors and limits"\n'
        "\n1 of 1 story failed: refusal\n"
    )


def test_the_socket_may_be_an_argument_and_the_outcome_json() -> None:
    code = "import os, sys; assert sys.argv[1] == os.environ['BUSD_SOCKET']; sys.exit('seen')"
    command = (sys.executable, "-c", code, "{socket}")
    result = bus("doctor", "--json", "--conformance", "--story", "hello", "--", *command)
    assert result.code == 1
    assert result.out == (
        '{"story":"hello","mark":"fail","text":"the client ended with status 1","output":["seen"]}\n'
    )


def test_mistakes_of_the_user() -> None:
    result = bus("doctor", "--conformance")
    assert (result.code, result.err) == (1, "which client? bus doctor --conformance -- ./client ARGS\n")
    result = bus("doctor", "--story", "hello")
    assert (result.code, result.err) == (1, "which client? bus doctor --conformance -- ./client ARGS\n")
    result = bus("doctor", "--conformance", "--wait", "0", "--", "./missing")
    assert (result.code, result.err) == (1, "--wait is above 0, not 0\n")
    result = bus("doctor", "--conformance", "--", "./missing")
    assert (result.code, result.err) == (1, "./missing can't be started: No such file or directory\n")
