"""`bus bag record`, as a process: the content of the bag, and the report of missing messages."""

import json
import os
import re
import resource
import select
import shlex
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path
from xml.etree import ElementTree

import pytest

from bus_bag.losses import TopicLosses
from cli import BUS, bus, script, wait_for_graph
from conftest import WAIT_S, Daemon
from neighbours import wait_until
from recording import Bag, end, recording, speaking
from terminals import OwnTerminal

pytestmark = pytest.mark.usefixtures("daemon")

ON_TMPFS = 'mount -t tmpfs -o size=3m none "$1" && shift && { "$@"; echo $?; read -r _; }'
"""A shell's script: run a command beside a small tmpfs, which stays until a line comes."""


@pytest.fixture
def bag(tmp_path: Path) -> Bag:
    return Bag(tmp_path / "walk")


def call(service: str, kind: str, words: str = "{}") -> str:
    """The response of a service of the recorder."""
    result = bus("service", "call", f"/rosbag2_recorder/{service}", f"rosbag2_interfaces/srv/{kind}", words)
    assert result.code == 0, result.err
    return result.out.splitlines()[-2 if result.out.endswith("\n\n") else -1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_what_is_said_is_recorded(bag: Bag, number: int) -> None:
    with speaking() as speaker:
        speaker.say("/topic")
        with recording(bag, "-a", "--custom-data", "site=hall") as recorder:
            speaker.say("/topic", *range(50))
            result = recorder.end(number)
    assert (result.out, result.code) == ("", 0)
    assert result.err.endswith("[rosbag2_recorder]: Recording stopped\n")
    assert bag.texts() == [str(number) for number in range(50)]
    losses = bag.losses()
    assert losses["/topic"] == TopicLosses(50, 50)
    assert all(one.is_balanced and not one.lost and not one.waiting for one in losses.values())
    assert bag.metadata.custom_data == {"site": "hall"}
    assert bag.metadata.relative_file_paths == ("walk_0.mcap",)
    (topic,) = [one.topic_metadata for one in bag.metadata.topics if one.topic_metadata.name == "/topic"]
    assert (topic.type, [qos.depth for qos in topic.offered_qos_profiles]) == ("std_msgs/msg/String", [1000])
    _, channel, message = bag.messages(bag.files[0])[0]
    assert message.sequence == 1
    assert 0 < message.log_time - message.publish_time < 10**9
    assert set(channel.metadata) == {
        "offered_qos_profiles",
        "topic_type_hash",
        "busd.type_hash",
        "busd.schema",
    }


def test_in_the_background_of_a_script(bag: Bag) -> None:
    """There a shell makes the program ignore SIGINT."""
    command = shlex.join([*BUS, "bag", "record", "-o", str(bag.folder), "/topic"])
    script = f"{command} & echo $!; wait $!; echo $?"
    with subprocess.Popen(["sh", "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as shell:
        assert shell.stdout is not None and shell.stderr is not None
        recorder = int(shell.stdout.readline())
        try:
            while b"Recording..." not in shell.stderr.readline():
                pass
            os.kill(recorder, signal.SIGINT)
            readable, _, _ = select.select([shell.stdout], [], [], WAIT_S)
            assert readable and shell.stdout.readline() == b"0\n"
        finally:
            if shell.poll() is None:
                with suppress(ProcessLookupError):
                    os.kill(recorder, signal.SIGKILL)


def test_what_does_not_go_together(tmp_path: Path) -> None:
    def refused(*options: str) -> str:
        result = bus("bag", "record", *options)
        assert (result.out, result.code) == ("", 1)
        return result.err

    assert refused("-o", str(tmp_path / "walk")) == (
        "[ERROR] [ros2bag]: Need to specify at least one option out of --all, --all-topics, --all-services, "
        "--services, --topics, --topic-types or --regex\n"
    )
    assert refused("-a", "-o", str(tmp_path)) == (
        f"[ERROR] [ros2bag]: Output folder '{tmp_path}' already exists.\n"
    )
    assert refused("-a", "--use-sim-time", "--no-discovery") == (
        "[ERROR] [ros2bag]: --use-sim-time and --no-discovery both set, but are incompatible settings. The "
        "/clock topic needs to be discovered to record with sim time.\n"
    )
    assert refused("-e", "[", "-o", str(tmp_path / "walk")).startswith("'[' is not a regular expression: ")
    assert refused("/a!").startswith("Invalid topic name: topic name must not contain characters other than")
    assert refused("-a", "--custom-data", "a=b=c", "site") == (
        "[ERROR] [ros2bag]: --custom-data takes KEY=VALUE, not 'site'\n"
    )
    qos = tmp_path / "qos.yaml"
    for content, text in (
        (b"/topic: {depth: 5, colour: red}", "Unexpected key `colour` for QoS profile."),
        (b"/topic: [", f"'{qos}' can't be used: it is not YAML, line "),
        (b"\xff\xfe\0", f"'{qos}' can't be used: it is not YAML: "),
        (b"[" * 100_000, f"'{qos}' can't be used: it is nested too deeply"),
    ):
        qos.write_bytes(content)
        told = refused("-a", "--qos-profile-overrides-path", str(qos))
        assert told.startswith(f"[ERROR] [ros2bag]: {text}")
        assert told.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir() if path.is_dir()] == []


class TestFaults:
    def test_a_full_disk(self, bag: Bag) -> None:
        """With a limit of the file's size: the recorder closes the bag and counts the rest as lost."""
        with speaking() as speaker:
            speaker.say("/topic")
            with recording(bag, "/topic") as recorder:
                resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (30_000, 30_000))
                for _ in range(20):
                    speaker.say("/topic", *range(200))
                code = recorder.process.wait(WAIT_S)
                text = recorder.error_line_with("can't grow")
        assert code == 1
        assert re.search(r"walk_0\.mcap can't grow beyond [\d,]+ bytes: File too large; the bag has", text)
        assert bag.files[0].stat().st_size <= 30_000
        losses = bag.losses()["/topic"]
        assert losses.is_balanced
        assert losses.written == len(bag.texts()) == bag.metadata.message_count
        assert losses.lost["not_written"] > 0

    def test_a_full_tmpfs(self, tmp_path: Path) -> None:
        """The recorder has reserved room there for the end of the file."""
        disk = tmp_path / "disk"
        disk.mkdir()
        recorder = (*BUS, "bag", "record", "/topic", "-o", f"{disk}/walk")
        words = ["unshare", "--mount", "sh", "-c", ON_TMPFS, "-", str(disk), *recorder]
        pipe = subprocess.PIPE
        with speaking() as speaker, subprocess.Popen(words, stdin=pipe, stdout=pipe, stderr=pipe) as shell:
            assert shell.stdin is not None and shell.stdout is not None and shell.stderr is not None
            speaker.say("/topic")
            while b"Recording..." not in (line := shell.stderr.readline()):
                if not line or b"not permitted" in line:
                    pytest.skip("may make no mount")
            for _ in range(10):
                speaker.say("/topic", *["x" * 1000] * 400)
            assert shell.stdout.readline() == b"1\n"
            bag = Bag(Path(f"/proc/{shell.pid}/root{disk}/walk"))
            losses = bag.losses()["/topic"]
            assert losses.is_balanced
            assert 500 < losses.written == bag.read_by_others() == bag.metadata.message_count < 2100
            assert losses.lost["not_written"] > 0
            _, said = shell.communicate(b"\n", WAIT_S)
        assert b"walk_0.mcap can't grow beyond " in said
        assert b"No space left on device; the bag has" in said

    def test_killed(self, bag: Bag) -> None:
        """Only messages of the last second are missing."""
        with speaking() as speaker:
            speaker.say("/topic")
            with recording(bag, "/topic") as recorder:
                speaker.say("/topic", *range(100))
                wait_until(lambda: len(bag.texts_now()) == 100)
                recorder.process.kill()
                recorder.process.wait(WAIT_S)
        assert bag.texts_now() == [str(number) for number in range(100)]

    def test_killed_at_any_moment(self, tmp_path: Path) -> None:
        """The file is readable up to some message, and `reindex` repairs it."""
        with speaking() as speaker:
            speaker.say("/topic")
            for count in (3, 300, 900):
                bag = Bag(tmp_path / f"walk_{count}")
                with recording(bag, "/topic") as recorder:
                    for begin in range(0, count, 3):
                        speaker.say("/topic", *range(begin, begin + 3))
                        if begin == 300:
                            wait_until(lambda bag=bag: len(bag.texts_now()) >= 300)
                    recorder.process.kill()
                    recorder.process.wait(WAIT_S)
                texts = bag.texts_now()
                assert texts == [str(number) for number in range(len(texts))]
                assert count < 900 or len(texts) >= 300
                result = bus("bag", "reindex", str(bag.folder))
                assert result.code == 0, result.err
                assert bag.texts() == texts
                assert bag.metadata.message_count == len(texts)

    def test_busd_restarts(self, bag: Bag, daemon: Daemon, route: str) -> None:
        """The recording continues. By socket, the publisher keeps 20 messages; others are counted as lost."""
        with speaking(depth=20) as speaker:
            speaker.say("/topic")
            with recording(bag, "/topic") as recorder:
                speaker.say("/topic", *range(10))
                wait_until(lambda: len(bag.texts_now()) == 10)
                daemon.kill()
                speaker.say("/topic", *range(10, 100))
                daemon.restart()
                wait_for_graph(lambda graph: graph.matches)
                speaker.say("/topic", *range(100, 110))
                wait_until(lambda: bag.texts_now()[-1:] == ["109"])
                result = end(recorder)
        assert result.code == 0
        losses = bag.losses()["/topic"]
        assert losses.is_balanced
        assert losses.expected == 110
        assert "unexplained" not in losses.lost
        numbers = [int(text) for text in bag.texts()]
        assert numbers == sorted(set(numbers))
        assert len(numbers) == losses.written >= 20
        assert route == "shm" or losses.lost

    def test_what_an_absence_of_busd_cost_is_spread_over_it(
        self, bag: Bag, daemon: Daemon, route: str
    ) -> None:
        if route == "shm":
            pytest.skip("the publisher's ring goes on without busd")
        with speaking(depth=5) as speaker:
            speaker.say("/topic")
            with recording(bag, "/topic") as recorder:
                speaker.say("/topic", *range(10))
                wait_until(lambda: len(bag.texts_now()) == 10)
                daemon.kill()
                killed_s = time.time()
                speaker.say("/topic", *range(10, 100))
                time.sleep(3)
                daemon.restart()
                wait_for_graph(lambda graph: graph.matches)
                speaker.say("/topic", "again")
                wait_until(lambda: bag.texts_now()[-1:] == ["again"])
                end(recorder)
        slots = bag.losses()["/topic"].when
        assert len(slots) >= 3
        assert slots[0].at_s <= killed_s + 1  # dated at busd's return, it would be three seconds later
        assert max(slot.count for slot in slots) < 45

    def test_when_messages_were_lost(self, bag: Bag, daemon: Daemon, tmp_path: Path) -> None:
        """The recorder stands still, and loses what its depth does not hold. Then info draws that moment."""
        qos = tmp_path / "qos.yaml"
        qos.write_text("/topic:\n  reliability: best_effort\n  history: keep_last\n  depth: 5\n")
        with speaking() as speaker:
            speaker.say("/topic")
            with recording(bag, "/topic", "--qos-profile-overrides-path", str(qos)) as recorder:
                speaker.say("/topic", *range(3))
                wait_until(lambda: len(bag.texts_now()) == 3)
                recorder.process.send_signal(signal.SIGSTOP)
                began_s = time.time()
                speaker.say("/topic", *range(100, 300))
                recorder.process.send_signal(signal.SIGCONT)
                wait_until(lambda: bag.texts_now()[-1:] == ["299"])
                end(recorder)
        losses = bag.losses()["/topic"]
        lost = losses.expected - losses.written
        assert lost > 100
        assert losses.timeline.total == lost
        assert {slot.at_s for slot in losses.when} <= {*range(int(began_s), int(time.time()) + 1)}
        result = bus("bag", "info", "--plot", "--svg", str(tmp_path / "lost.svg"), str(bag.folder))
        assert (result.code, result.err) == (0, "")
        block = result.out.partition("Losses over time:\n")[2].splitlines()
        assert block[0] == f"/topic: lost {lost} of 203"
        assert "█" in block[1]
        bursts = " ".join(line.partition(" s: ")[2] for line in block[2:-1])
        assert sum(map(int, re.findall(r"\d+", bursts))) == lost
        root = ElementTree.parse(tmp_path / "lost.svg").getroot()
        assert root.findtext("{http://www.w3.org/2000/svg}title") == f"Lost messages of {bag.folder.name}"
        told = json.loads(bus("bag", "info", "--json", str(bag.folder)).out)["losses"]["/topic"]
        assert told["when"] == [[slot.at_s, 1, slot.lost] for slot in losses.when]

    def test_ctrl_c_twice(self, bag: Bag) -> None:
        with speaking() as speaker:
            speaker.say("/topic")
            with recording(bag, "/topic") as recorder:
                speaker.say("/topic", *range(100))
                recorder.process.send_signal(signal.SIGINT)
                result = end(recorder)
        assert result.code == 0
        losses = bag.losses()["/topic"]
        assert losses.is_balanced
        assert losses.written == len(bag.texts())

    def test_a_type_that_ros_2_can_not_describe(self, bag: Bag) -> None:
        speaker = """
import asyncio, bus
class Note(bus.msg.Message, kw_only=True):
    text: str = ""
    place: tuple[int, str] = (0, "")
async def main():
    async with bus.Node("speaker") as node:
        publisher = await node.create_publisher(Note, "note", bus.QoSProfile(1, durability="transient_local"))
        publisher.publish(Note(text="here", place=(1, "hall")))
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""
        with script(speaker), recording(bag, "/note") as recorder:
            wait_until(lambda: len(bag.messages_now("/note")) == 1)
            end(recorder)
        assert '[1,"hall"]' in str(bag.messages(bag.files[0], "/note")[0][2].data)


class TestLatched:
    def test_what_each_publisher_keeps(self, bag: Bag) -> None:
        """Also if other publishers of the topic keep no messages, and on topics that appear later."""
        with speaking("first") as first, speaking("second") as second:
            first.keep("/map", "old", "hall")
            second.say("/map", "unheard")
            with recording(bag, "-a") as recorder:
                second.say("/map", "news")
                second.keep("/plan", "walk")
                wait_until(lambda: bag.texts_now("/plan") == ["walk"])
                end(recorder)
        assert sorted(bag.texts("/map")) == ["hall", "news"]
        assert bag.losses()["/map"] == TopicLosses(2, 2)

    def test_further_files_begin_with_it(self, bag: Bag) -> None:
        with speaking() as speaker:
            speaker.keep("/map", "hall")
            speaker.say("/topic")
            with recording(bag, "/map", "/topic", "-b", "3000", "--max-bag-files", "2") as recorder:
                for number in range(4):
                    speaker.say("/topic", *range(number * 50, number * 50 + 50))
                    wait_until(lambda count=number: str(count * 50 + 49) in bag.texts_now())
                end(recorder)
        assert len(bag.files) == 2
        assert bag.files[0].name != "walk_0.mcap"
        for file in bag.files:
            ((_, _, message),) = bag.messages(file, "/map")
            assert message.sequence == 1
            assert message.log_time <= bag.messages(file)[0][2].log_time
        losses = bag.losses()
        assert losses == {"/map": TopicLosses(1, 1), "/topic": TopicLosses(200, 200)}
        assert bag.metadata.relative_file_paths == tuple(file.name for file in bag.files)
        assert bag.metadata.message_count == len(bag.texts()) + 2
        assert bag.texts()[-1] == "199"


class TestServices:
    def test_pause_and_split(self, bag: Bag) -> None:
        with speaking() as speaker:
            speaker.say("/topic")
            with recording(bag, "/topic", "/map", "/events/write_split", "--start-paused") as recorder:
                assert "paused=True" in call("is_paused", "IsPaused")
                speaker.keep("/map", "hall")
                speaker.say("/topic", "unheard")
                recorder.error_line_with("Subscribed to topic '/map'")
                call("resume", "Resume")
                speaker.say("/topic", "heard")
                call("split_bagfile", "SplitBagfile")
                wait_until(lambda: len(bag.files) == 2)
                call("pause", "Pause")
                speaker.say("/topic", "unheard", "too")
                call("resume", "Resume")
                speaker.say("/topic", "again")
                result = end(recorder)
        assert re.findall(r"(\w+ recording)\.", result.err) == [
            "Resuming recording",
            "Pausing recording",
            "Resuming recording",
        ]
        assert bag.texts() == ["heard", "again"]
        assert bag.texts("/map") == ["hall", "hall"]
        assert bag.losses()["/topic"] == TopicLosses(2, 2)
        assert bag.losses()["/map"] == TopicLosses(1, 1)
        [(_, _, split)] = bag.messages(bag.files[1], "/events/write_split")
        assert b"/rosbag2_recorder\0" in split.data  # CDR

    def test_snapshot(self, bag: Bag) -> None:
        options = ("--snapshot-mode", "--max-cache-size", "100")
        with speaking() as speaker:
            speaker.keep("/map", "hall")
            speaker.say("/topic")
            with recording(bag, "/topic", "/map", *options) as recorder:
                for number in range(40):
                    speaker.say("/topic", number)
                    if number in (10, 20, 30):
                        call("is_paused", "IsPaused")  # the recorder has taken all messages before
                assert "success=True" in call("snapshot", "Snapshot")
                speaker.say("/topic", "unheard")
                result = end(recorder)
        assert f"Writing a snapshot: {bag.metadata.message_count} messages." in result.err
        texts = bag.texts()
        assert texts == [str(number) for number in range(40)][-len(texts) :]
        assert 10 <= len(texts) < 40
        assert bag.texts("/map") == ["hall"]
        (file,) = bag.files
        assert bag.messages(file, "/map")[0][2].log_time <= bag.messages(file, "/topic")[0][2].log_time
        assert bag.losses()["/topic"] == TopicLosses(len(texts), len(texts))


def test_simulated_time(bag: Bag) -> None:
    clock = """
import asyncio, bus
from bus.types.classes import message_class
Clock = message_class("rosgraph_msgs/msg/Clock")
async def main():
    async with bus.Node("simulator") as node:
        publisher = await node.create_publisher(Clock, "/clock", 10)
        print("ready", flush=True)
        turns_before_begin = 20
        while True:
            sec = 0 if turns_before_begin else 100
            publisher.publish(Clock(clock=bus.msg.builtin_interfaces.Time(sec=sec)))
            await asyncio.sleep(0.02)
            if turns_before_begin and publisher.get_subscription_count():
                turns_before_begin -= 1
bus.run(main())
"""
    with script(clock), speaking() as speaker:
        speaker.keep("/map", "hall")
        speaker.say("/topic")
        with recording(bag, "/topic", "/map", "--use-sim-time") as recorder:
            speaker.say("/topic", "walk")
            wait_until(lambda: bag.texts_now() == ["walk"])
            end(recorder)
    assert bag.texts("/map") == ["hall"]
    for topic in ("/topic", "/map"):
        ((_, _, message),) = bag.messages(bag.files[0], topic)
        assert message.log_time == 100 * 10**9


def test_a_terminal_that_is_closed(bag: Bag) -> None:
    with speaking() as speaker:
        speaker.say("/topic")
        with OwnTerminal(*BUS[1:], "bag", "record", "/topic", "-o", str(bag.folder)) as terminal:
            terminal.read_until("Recording...")
            speaker.say("/topic", "heard")
            terminal.close()
            assert terminal.wait() == 0
    assert bag.texts() == ["heard"]


def test_on_a_terminal(bag: Bag) -> None:
    """SPACE pauses, a status line shows the progress, and the terminal is restored."""
    words = ("bag", "record", "/topic", "-o", str(bag.folder), "--progress-bar-update-rate", "50")
    with speaking() as speaker:
        speaker.say("/topic")
        with OwnTerminal(*BUS[1:], *words) as terminal:
            before = terminal.mode()
            terminal.read_until("Recording...")
            speaker.say("/topic", "heard")
            terminal.read_until("recording 0:00:0[0-9] .* 1 messages .* lost 0")
            terminal.write(" ")
            terminal.read_until("Pausing recording.")
            terminal.read_until("paused 0:00:0")
            speaker.say("/topic", "unheard")
            terminal.write(" ")
            terminal.read_until("Resuming recording.")
            terminal.write("\x03")
            terminal.read_until("Recording stopped")
            assert terminal.wait() == 0
            assert terminal.mode() == before
    assert bag.texts() == ["heard"]
