"""Playback of bags: order, times, QoS, latched state, pauses, seeks, and all services."""

import re
import signal
import time
from contextlib import aclosing
from pathlib import Path
from typing import Any, Literal

import msgspec
import pytest

import bus
from bus.msg.builtin_interfaces import Time
from bus.msg.std_msgs import Int64, String
from bus.qos import QoSProfile, sensor_data
from bus.schema import MessageSchema
from bus.types.classes import message_class
from bus_bag.metadata import TopicMetadata
from bus_bag.storage import BagWriter
from bus_cli import main
from bus_ros.cdr import codec_of
from cli import start
from conftest import Daemon
from playing import LATCHED, MS, START, Audience, Sample, replay, write_bag
from programs import on_one_loop
from semantics import node, until

__all__ = ["node"]


@pytest.fixture
def audience(daemon: Daemon, node: bus.Node) -> Audience:
    return Audience(node)


def counted(count: int, step_ms: float = 5.0, topic: str = "/numbers") -> list[Sample]:
    return [Sample(topic, number * step_ms, Int64(data=number)) for number in range(count)]


@pytest.mark.usefixtures("route")
async def test_all_messages_come_in_order_at_their_times_and_with_their_stamps(
    audience: Audience, tmp_path: Path
) -> None:
    bag = write_bag(
        tmp_path / "bag", [*counted(40), Sample("/words", 201, String(data="end"), published_ms=190.5)]
    )
    await audience.listen(Int64, "/numbers")
    await audience.listen(String, "/words")
    begin = time.monotonic()
    async with replay(audience.node, bag) as player:
        await player.task
    assert time.monotonic() - begin >= 0.2
    await audience.has_heard(41)
    assert (audience.texts("/numbers"), audience.texts("/words")) == (list(range(40)), ["end"])
    stamps = {one.source_ms for one in audience.heard}
    assert stamps == {*(5.0 * number for number in range(40)), 190.5}


@on_one_loop
async def test_several_bags_are_played_as_one(audience: Audience, tmp_path: Path) -> None:
    even, odd = counted(40)[::2], counted(40)[1::2]
    words = [Sample("/words", 51, String(data="between"))]
    late = [Sample("/numbers", 52, String(data="of another type"))]
    bags = [
        write_bag(tmp_path / name, samples)
        for name, samples in zip("abc", (odd, even, late + words), strict=True)
    ]
    await audience.listen(Int64, "/numbers")
    await audience.listen(String, "/words")
    async with replay(audience.node, *bags, start_offset=50 * MS) as player:
        await player.task
    await audience.has_heard(31)
    assert audience.texts("/numbers") == list(range(10, 40))
    assert audience.texts("/words") == ["between"]


@on_one_loop
async def test_the_recorded_qos_is_offered(audience: Audience, tmp_path: Path) -> None:
    held = QoSProfile(3, deadline=0.5, liveliness="manual_by_topic", liveliness_lease_duration=2.0)
    qos = {"/sensor": [sensor_data], "/held": [held], "/mixed": [sensor_data, held], "/over": [held]}
    bag = write_bag(tmp_path / "bag", [Sample(topic, 0, Int64()) for topic in (*qos, "/none")], qos=qos)
    over = QoSProfile(7, reliability="best_effort")
    async with replay(audience.node, bag, is_paused=True, overrides={"/over": over}):
        graph = await published(audience.node, "/sensor")  # the last by name, so all topics are there
        offered = {topic: graph.publishers_of(topic)[0].qos for topic in (*qos, "/none")}
    assert offered == {
        "/sensor": sensor_data,
        "/held": held,
        "/mixed": QoSProfile(),
        "/none": QoSProfile(),
        "/over": over,
    }


@on_one_loop
async def test_a_late_joiner_gets_what_all_publishers_kept(audience: Audience, tmp_path: Path) -> None:
    samples = [Sample("/latched", number, String(data=str(number))) for number in range(5)]
    bag = write_bag(tmp_path / "bag", samples, qos={"/latched": [LATCHED] * 2})
    async with replay(audience.node, bag, is_paused=True) as player:
        assert (await player.call("burst", "Burst")).actually_burst == 5
        await audience.listen(String, "/latched", qos=QoSProfile(10, durability="transient_local"))
        await audience.has_heard(2)
    assert audience.texts() == ["3", "4"]


@on_one_loop
async def test_a_start_in_the_middle_begins_with_what_was_latched(audience: Audience, tmp_path: Path) -> None:
    maps = [Sample("/map", at_ms, String(data=f"map {at_ms}")) for at_ms in (0, 50, 100, 155)]
    bag = write_bag(tmp_path / "bag", [*maps, *counted(40)], qos={"/map": [LATCHED]})
    await audience.listen(String, "/map", qos=QoSProfile(10, durability="transient_local"))
    await audience.listen(Int64, "/numbers")
    async with replay(audience.node, bag, start_offset=150 * MS) as player:
        await player.task
    await audience.has_heard(12)
    assert audience.texts("/map") == ["map 100", "map 155"]
    assert audience.texts("/numbers") == list(range(30, 40))


@on_one_loop
async def test_a_seek_begins_with_what_was_latched_also_back_from_the_end(
    audience: Audience, tmp_path: Path
) -> None:
    maps = [Sample("/map", at_ms, String(data=f"map {at_ms}")) for at_ms in (0, 50, 120)]
    bag = write_bag(tmp_path / "bag", [*maps, *counted(30, 10.0)], qos={"/map": [LATCHED]})
    await audience.listen(String, "/map", qos=QoSProfile(10, durability="transient_local"))
    await audience.listen(Int64, "/numbers")
    async with replay(audience.node, bag, is_paused=True) as player:
        assert (await player.call("seek", "Seek", time=moment(95))).success
        await until(lambda: audience.texts() == ["map 50"])
        assert (await player.call("burst", "Burst")).actually_burst == 21
        await until(lambda: audience.texts("/numbers")[-1:] == [29])
        audience.heard.clear()
        assert not (await player.call("play_next", "PlayNext")).success
        assert (await player.call("seek", "Seek", time=moment(285))).success
        await until(lambda: audience.texts() == ["map 120"])
        await player.call("resume", "Resume")
        await player.task
    await until(lambda: audience.texts() == ["map 120", 29])


@on_one_loop
async def test_what_further_files_repeat_is_played_once(audience: Audience, tmp_path: Path) -> None:
    tf = [Sample("/tf_static", at_ms, String(data=f"tf {at_ms}")) for at_ms in (0, 1, 2)]
    repeated = [sample._replace(at_ms=20, published_ms=sample.at_ms) for sample in tf[1:]]
    words = [Sample("/words", at_ms, String(data="twice"), published_ms=5) for at_ms in (5, 21)]
    bag = write_bag(
        tmp_path / "bag",
        [*tf, words[0]],
        [*repeated, words[1], Sample("/tf_static", 22, String(data="tf 22"))],
        qos={"/tf_static": [LATCHED, LATCHED]},
    )
    await audience.listen(String, "/tf_static", "/words")
    async with replay(audience.node, bag) as player:
        await player.task
        await audience.has_heard(6)
        assert audience.texts("/tf_static") == ["tf 0", "tf 1", "tf 2", "tf 22"]
        assert audience.texts("/words") == ["twice", "twice"]
    alone = Audience(audience.node)
    await alone.listen(String, "/tf_static", "/words")
    async with replay(audience.node, bag / "bag_1.mcap") as player:
        await player.task
    await alone.has_heard(4)
    assert (alone.texts("/tf_static"), alone.texts("/words")) == (["tf 1", "tf 2", "tf 22"], ["twice"])


@on_one_loop
async def test_services_steer_it(audience: Audience, tmp_path: Path) -> None:
    bag = write_bag(
        tmp_path / "bag", [*counted(5, 1.0), *counted(1, topic="/end"), Sample("/end", 1e7, Int64())]
    )
    await audience.listen(Int64, "/numbers")
    async with replay(audience.node, bag, is_paused=True) as player:
        assert (await player.call("is_paused", "IsPaused")).paused
        assert (await player.call("get_rate", "GetRate")).rate == 1.0
        assert (await player.call("set_rate", "SetRate", rate=2.5)).success
        assert not (await player.call("set_rate", "SetRate", rate=-1.0)).success
        assert (await player.call("get_rate", "GetRate")).rate == 2.5
        assert (await player.call("play_next", "PlayNext")).success
        assert (await player.call("burst", "Burst", num_messages=3)).actually_burst == 3
        await until(lambda: audience.texts() == [0, 1, 2])
        await player.call("toggle_paused", "TogglePaused")
        assert not (await player.call("is_paused", "IsPaused")).paused
        assert not (await player.call("play_next", "PlayNext")).success
        assert (await player.call("burst", "Burst")).actually_burst == 0
        await until(lambda: audience.texts() == [0, 1, 2, 3, 4])
        assert not (await player.call("play", "Play")).success
        await player.call("stop", "Stop")
        await player.task


@on_one_loop
async def test_a_burst_comes_at_once_then_a_pause(audience: Audience, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", counted(10, 1e6))
    await audience.listen(Int64, "/numbers")
    async with replay(audience.node, bag, burst=4, is_paused=True) as player:
        await audience.has_heard(4)
        assert (await player.call("is_paused", "IsPaused")).paused
        assert audience.texts() == [0, 1, 2, 3]
        await player.call("stop", "Stop")
        await player.task


@on_one_loop
async def test_it_loops_from_its_start_and_ends_where_it_is_told(audience: Audience, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", counted(50, 1.0))
    await audience.listen(Int64, "/numbers")
    given = {"start_offset": 10 * MS, "duration": 5 * MS, "until": START + 12 * MS, "delay": MS}
    async with replay(audience.node, bag, is_looping=True, **given) as player:
        await audience.has_heard(18)
        await player.call("stop", "Stop")
        await player.task
    assert audience.texts()[:18] == [10, 11, 12, 13, 14, 15] * 3


@on_one_loop
async def test_nothing_is_played_for_no_time(audience: Audience, tmp_path: Path) -> None:
    await audience.listen(Int64, "/numbers")
    for given in ({"duration": 0}, {"start_offset": 10**12}):
        async with replay(audience.node, write_bag(tmp_path / f"{given}", counted(3)), **given) as player:
            await player.task
    assert audience.texts() == []


@on_one_loop
async def test_topics_are_chosen_and_renamed(audience: Audience, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", [Sample(f"/{name}", 0, String(data=name)) for name in "abc"])
    await audience.listen(String, "/a", "/b", "/c", "/new/a")
    async with replay(audience.node, bag, remaps=["/a:=/new/a"], exclude_topics=["/b"]) as player:
        await player.task
    await audience.has_heard(2)
    assert sorted((one.topic, one.message.data) for one in audience.heard) == [("/c", "c"), ("/new/a", "a")]


@on_one_loop
async def test_it_waits_until_all_has_left(
    audience: Audience, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    qos = {"/b": [sensor_data], "/c": [sensor_data]}
    bag = write_bag(tmp_path / "bag", [Sample(f"/{name}", 0, Int64()) for name in "abc"], qos=qos)
    await audience.listen(Int64, "/a", "/b", "/c", qos=sensor_data)
    for within_ms in (0, 5000):
        async with replay(audience.node, bag, acknowledged_within=within_ms) as player:
            await player.task
    await audience.has_heard(6)
    warning = "--wait-for-all-acked is invalid for the below topics since reliability of QOS is BestEffort.\n"
    assert capfd.readouterr().err.count(f"{warning}/b, /c\n") == 2


@on_one_loop
async def test_by_the_time_of_sending(audience: Audience, tmp_path: Path) -> None:
    samples = [
        Sample("/words", at_ms, String(data=f"{sent_ms}"), sent_ms)
        for at_ms, sent_ms in [(0, -9), (1, -20), (2, 1)]
    ]
    await audience.listen(String, "/words")
    async with replay(audience.node, write_bag(tmp_path / "bag", samples), order="publish_time") as player:
        await player.task
    await audience.has_heard(3)
    assert audience.texts() == ["-20", "-9", "1"]


@on_one_loop
@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"clock_topics": frozenset(["/numbers"])}, [START, START + 5 * MS]),
        ({"clock_topics": frozenset[str]()}, [START, START + 1 * MS, START + 5 * MS]),
    ],
)
async def test_the_clock_before_messages(
    audience: Audience, tmp_path: Path, given: dict[str, Any], expected: list[int]
) -> None:
    clock: Any = message_class("rosgraph_msgs/msg/Clock")
    bag = write_bag(
        tmp_path / "bag", [*counted(2), Sample("/other", 1, Int64()), Sample("/clock", 0.5, clock())]
    )
    await audience.listen(clock, "/clock", qos=QoSProfile(100, reliability="best_effort"))
    async with replay(audience.node, bag, **given) as player:
        await player.task
    await audience.has_heard(len(expected))
    assert [clock_ns(one.message) for one in audience.heard] == expected


@on_one_loop
async def test_the_clock_runs_and_stands(audience: Audience, tmp_path: Path) -> None:
    clock: Any = message_class("rosgraph_msgs/msg/Clock")
    bag = write_bag(tmp_path / "bag", [*counted(1), Sample("/end", 1e7, Int64())])
    await audience.listen(clock, "/clock", qos=QoSProfile(100, reliability="best_effort"))
    async with replay(audience.node, bag, clock_hz=500.0, rate=1000.0) as player:
        await until(lambda: audience.heard and clock_ns(audience.heard[-1].message) > START + 2_000 * MS)
        await player.call("pause", "Pause")
        await audience.has_heard(len(audience.heard) + 4)
    times = [clock_ns(one.message) for one in audience.heard]
    assert times == sorted(times) and times[-1] == times[-2]


class Own(msgspec.Struct):
    names: dict[str, int]
    maybe: float | None = None
    word: Literal["yes", "no"] = "yes"


@on_one_loop
async def test_types_that_ros_does_not_have_come_back_as_they_were(
    audience: Audience, tmp_path: Path
) -> None:
    own = Own({"a": 1, "b": 2}, 1.5, "no")
    bag = write_bag(tmp_path / "bag", [Sample("/own", 0, own), Sample("/own", 1, Own({}))], with_schema=True)
    await audience.listen(Own, "/own")
    async with replay(audience.node, bag) as player:
        await player.task
    await audience.has_heard(2)
    assert [one.message for one in audience.heard] == [own, Own({})]


@on_one_loop
async def test_what_cannot_be_played_is_told_and_the_rest_plays(
    audience: Audience, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    writer = BagWriter(tmp_path / "bag")
    text = codec_of(MessageSchema.of(String))
    good = text.encode(b"\x91\xa4good")
    for name, type_name, form, definition, data in (
        ("/good", "std_msgs/msg/String", "cdr", text.definition, good),
        ("/broken", "std_msgs/msg/String", "cdr", text.definition, [b"\0\1\0\0\x10"]),
        ("/json", "std_msgs/msg/String", "json", text.definition, [b"{}"]),
        ("/unknown", "nowhere/msg/Nothing", "cdr", "", [b"\0\1\0\0"]),
        ("/wrong", "own/msg/Wrong", "cdr", "wrong/Type x", [b"\0\1\0\0"]),
        ("/no-topic", "std_msgs/msg/String", "cdr", text.definition, good),
    ):
        channel = writer.add_topic(TopicMetadata(name, type_name, form), definition, {})
        writer.write(channel, START, START, 1, list(data))
    writer.close()
    await audience.listen(String, "/good")
    async with replay(
        audience.node,
        tmp_path / "bag",
        topics=["/good", "/broken", "/json", "/unknown", "/wrong", "/no-topic", "/goood"],
    ) as player:
        await player.task
    await audience.has_heard(1)
    lines = [line.partition("]: ")[2] for line in capfd.readouterr().err.splitlines() if "[WARN]" in line]
    assert [re.sub(r"reason: .+\.$|left out: .+", "", line) for line in lines] == [
        "Topic '/goood' is not in the bag; did you mean '/good'?",
        *(f"Ignoring a topic '/{name}', " for name in ("json", "no-topic", "unknown", "wrong")),
        "1 message of '/broken' ",
    ]


@on_one_loop
async def test_what_cannot_be_read_is_told_and_the_rest_plays(
    audience: Audience, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    samples = counted(6)
    bag = write_bag(tmp_path / "bag", *([sample] for sample in samples))
    broken = bag / "bag_3.mcap"
    data = bytearray(broken.read_bytes())
    at = data.index(b"\0\1\0\0\3\0\0\0")
    data[at - 40 : at + 8] = b"\xff" * 48
    broken.write_bytes(data)
    (bag / "bag_1.mcap").write_bytes(b"no bag at all")
    await audience.listen(Int64, "/numbers")
    async with replay(audience.node, bag) as player:
        await player.task
    await audience.has_heard(4)
    assert audience.texts() == [0, 2, 4, 5]
    told = [line for line in capfd.readouterr().err.splitlines() if "[WARN]" in line]
    assert ["bag_1.mcap" in told[0], "bag_3.mcap" in told[-1]] == [True, True]


@on_one_loop
async def test_bags_that_others_wrote(audience: Audience, tmp_path: Path) -> None:
    """MCAP and SQLite, with QoS as names and as numbers; playback needs no package of ROS 2."""
    kinds: list[tuple[str, Literal[8, 9]]] = [("mcap", 9), ("mcap", 8), ("sqlite3", 9), ("sqlite3", 8)]
    for storage, version in kinds:
        bag = write_with_rosbags(tmp_path / f"{storage}{version}", storage, version)
        heard = Audience(audience.node)
        await heard.listen(String, "/words", qos=QoSProfile(10, durability="transient_local"))
        async with replay(audience.node, bag) as player:
            await player.task
        await heard.has_heard(3)
        assert heard.texts() == ["0", "1", "2"], (storage, version)


def write_with_rosbags(folder: Path, storage: str, version: Literal[8, 9]) -> Path:
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    never = QosTime(0, 0)
    latched = Qos(
        *(QosHistory.KEEP_LAST, 5, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL, never, never),
        *(QosLiveliness.AUTOMATIC, never, False),
    )
    with Writer(folder, version=version, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        kind = "std_msgs/msg/String"
        connection = writer.add_connection("/words", kind, typestore=store, offered_qos_profiles=[latched])
        for number in range(3):
            data = store.serialize_cdr(store.types[kind](str(number)), kind)
            writer.write(connection, START + number * MS, data)
    return folder


def moment(at_ms: float) -> Any:
    seconds, nanoseconds = divmod(START + round(at_ms * MS), 10**9)
    return Time(sec=seconds, nanosec=nanoseconds)


def clock_ns(message: Any) -> int:
    return int(message.clock.sec * 10**9 + message.clock.nanosec)


async def published(node: bus.Node, topic: str) -> bus.Graph:
    """The first graph with a publisher on the topic."""
    async with aclosing(node.watch_graph()) as graphs:
        async for graph in graphs:
            if graph.publishers_of(topic):
                return graph
    raise AssertionError("it has ended")


LOGGED = r"^\[(?:INFO|WARN)\] \[\d+\.\d{9}\] \[rosbag2_player\]: "


def test_the_program(daemon: Daemon, tmp_path: Path) -> None:
    write_bag(tmp_path / "bag", counted(20, 1.0))
    with start("bag", "play", str(tmp_path / "bag"), "-v", "-r", "2", is_fresh=True) as player:
        result = player.end()
    assert (result.out, result.code) == ("", 0)
    lines = [re.sub(LOGGED, "", line) for line in result.err.splitlines()]
    assert lines[:-1] == [
        "Set rate to 2",
        "stdin is not a terminal device. Keyboard handling disabled.",
        "Playback until timestamp: -1",
    ]
    assert re.fullmatch(r"Lateness: p50 .* ms, p99 .* ms, max .* ms \(20 messages\)", lines[-1])


def test_a_message_of_1970_is_named_and_its_gap_is_skipped(daemon: Daemon, tmp_path: Path) -> None:
    (first, *rest) = counted(3)
    write_bag(tmp_path / "bag", [first._replace(at_ms=5000 - START / MS), *rest])
    with start("bag", "play", str(tmp_path / "bag")) as player:
        line = player.error_line_with("No messages for")
        assert line.endswith("No messages for 56.9 years after 0.00 s. To skip such gaps: --skip-gaps 60")
        player.error_line_with("Playback until")
        player.end(signal.SIGINT)
    with start("bag", "play", str(tmp_path / "bag"), "--skip-gaps", "1", "-v") as player:
        result = player.end()
    assert result.code == 0 and "(3 messages)" in result.err
    assert "Skipping 1 gap of more than 1 s: 56.9 years in total." in result.err


def test_a_burst_without_a_terminal_says_how_it_continues(daemon: Daemon, tmp_path: Path) -> None:
    write_bag(tmp_path / "bag", counted(3))
    with start("bag", "burst", str(tmp_path / "bag"), "-n", "2") as player:
        player.error_line_with("Burst 2 messages.")
        line = player.error_line_with("Paused")
        assert main.run(line.partition("bus ")[2].split()) == 0
        result = player.end()
    assert result.code == 0


def test_ctrl_c_ends_it_without_a_traceback(daemon: Daemon, tmp_path: Path) -> None:
    write_bag(tmp_path / "bag", counted(2, 3_600_000.0))
    with start("bag", "play", str(tmp_path / "bag")) as player:
        player.error_line_with("Playback until")
        result = player.end(signal.SIGINT)
    assert (result.out, result.err, result.code) == ("", "", -signal.SIGINT)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("none",), "Bag path 'none' does not exist!"),
        (("bag", "--services", "/nope"), "Nothing to play of /nope: the bag has events of no service"),
        (("bag", "-e", "/nothing.*"), "the options choose no topic of the bag. It has /numbers"),
        (("bag", "--skip-gaps", "1", "-x", ".*"), "the options choose no topic of the bag. It has /numbers"),
        (("bag", "-e", "("), "'(' is not a regular expression: "),
        (("bag", "-m", "x"), "--remap"),
        (("bag", "--qos-profile-overrides-path", "qos.yaml"), "[ERROR] [ros2bag]: Unexpected key `dep` for"),
        (("bag", "--qos-profile-overrides-path", "none.yaml"), "No such file or directory: 'none.yaml'"),
    ],
)
def test_mistakes(
    socket_path: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    text: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    write_bag(Path("bag"), counted(1))
    Path("qos.yaml").write_text("/numbers: {dep: 3}")
    assert main.run(["bag", "play", *words]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert text in line
