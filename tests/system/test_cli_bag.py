"""`bus bag info`, `reindex`, `convert`: their output, and errors of one sentence if it is not a bag."""

import json
import signal
from pathlib import Path

from bags import read, said, write_bag
from bus_bag.storage import open_bag
from bus_cli.query import Query
from cli import TALKER, bus, script, start
from conftest import Daemon
from neighbours import wait_until


def test_info(tmp_path: Path) -> None:
    messages = said(10)
    folder = write_bag(tmp_path / "walk", messages[:5], messages[5:])
    result = bus("bag", "info", str(folder))
    assert (result.code, result.err) == (0, "")
    assert result.out.startswith(
        "\nFiles:             walk_0.mcap\n                   walk_1.mcap\nBag size:"
    )
    assert bus("bag", "info", "-t", str(folder)) == ("/chatter\n/latched\n", "", 0)
    assert bus("bag", "info", "-t", "--sort", "count", str(folder)).out == "/latched\n/chatter\n"
    assert "Size Contribution" in bus("bag", "info", "-v", "-s", "mcap", str(folder)).out
    record = json.loads(bus("bag", "info", "--json", str(folder)).out)
    assert (record["message_count"], record["is_cut"], record["problems"]) == (10, False, [])


def test_nothing_to_draw(tmp_path: Path) -> None:
    folder, picture = write_bag(tmp_path / "walk", said(10)), tmp_path / "lost.svg"
    assert bus("bag", "info", "--plot", str(folder)).out.endswith(
        "\n\nNo record of losses: this bag is of another recorder.\n"
    )
    assert bus("bag", "info", "--svg", str(picture), str(folder)).code == 0
    assert "walk: nothing was lost" in picture.read_text()
    assert bus("bag", "info", "--svg", str(tmp_path / "no" / "lost.svg"), str(folder)) == (
        "",
        f"can't write {tmp_path}/no/lost.svg: No such file or directory\n",
        1,
    )


def test_a_bag_that_was_cut(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "walk", said(10))
    path = folder / "walk_0.mcap"
    path.write_bytes(path.read_bytes()[:-1])
    (folder / "metadata.yaml").unlink()
    result = bus("bag", "info", str(folder))
    assert result.code == 0
    assert "Messages:          10\n" in result.out
    first, second, third = result.err.splitlines()
    assert (
        first == f"[WARN] [ros2bag]: {folder}/metadata.yaml: it is missing; the bag's files are read instead"
    )
    assert second.startswith(f"[WARN] [ros2bag]: {path}, at byte ")
    assert second.endswith(": the file was not closed")
    assert third == f"[WARN] [ros2bag]: to repair it: bus bag reindex {folder}"
    result = bus("bag", "reindex", str(folder))
    assert (result.code, result.err) == (0, f"{second}\n")
    assert result.out == (
        "walk_0.mcap: rewritten with an index, 10 messages\nmetadata.yaml: 10 messages in 1 file\n"
    )
    assert bus("bag", "info", str(folder)).err == ""


def test_no_bags(tmp_path: Path) -> None:
    (tmp_path / "junk.mcap").write_bytes(b"junk")
    junk = f"{tmp_path}/junk.mcap"
    assert bus("bag", "info", "nowhere") == ("", "Bag path 'nowhere' does not exist!\n", 1)
    assert bus("bag", "info", junk) == (
        "",
        f"'{junk}' is not an MCAP file: its first bytes are different\n",
        1,
    )
    assert bus("bag", "reindex", junk) == ("", "[ERROR] [ros2bag]: Must specify a bag directory\n", 1)


def test_list() -> None:
    assert bus("bag", "list", "storage") == ("mcap\nsqlite3\n", "", 0)
    assert bus("bag", "list", "converter") == ("cdr_converter\n", "", 0)
    assert bus("bag", "list", "compressor") == ("zstd\n", "", 0)
    verbose = bus("bag", "list", "decompressor", "--verbose").out
    assert verbose.startswith("available decompressor plugins are:\nname: zstd\n\t")
    record = json.loads(bus("bag", "list", "decompressor", "--json").out)
    assert (record["name"], record["type"]) == ("zstd", "bus_bag.storage.decompression")
    assert bus("bag", "list", "plugins").code == 2


def has_message(daemon: Daemon) -> bool:
    """Whether the recorder has taken a message: without one, a bag has no chunk."""
    with Query(daemon.path) as query:
        subscriptions = query.graph(statistics=True).subscriptions_of("/topic")
    return any(one.statistics is not None and one.statistics.samples for one in subscriptions)


def test_record_compressed(daemon: Daemon, tmp_path: Path) -> None:
    words = ("/topic", "-o", str(tmp_path / "walk"), "-f", "cdr", "--compression-mode", "file")
    with script(TALKER, "0.01"), start("bag", "record", *words) as record:
        assert record.error_line() == (
            "[WARN] [ros2bag]: --compression-mode file: chunks of messages are compressed instead, as with "
            "--storage-preset-profile zstd_fast"
        )
        record.error_line_with("Recording\\.\\.\\.")
        wait_until(lambda: has_message(daemon))
        assert record.end(signal.SIGINT).code == 0
    assert b"zstd" in (tmp_path / "walk" / "walk_0.mcap").read_bytes()
    refused = bus("bag", "record", "-a", "--storage-config-file", "x.yaml")
    assert (refused.out, refused.code) == ("", 1)
    assert refused.err.startswith("[ERROR] [ros2bag]: --storage-config-file is not available; ")


def test_bags_to_play(tmp_path: Path) -> None:
    bag = str(write_bag(tmp_path / "a", said(1)))
    mixed = (
        "[ERROR] [ros2bag]: do not mix the [bag_path] positional argument and the -i,--input option; for "
        "multiple input bags, use -i,--input multiple times\n"
    )
    assert bus("bag", "play", bag, "-i", bag) == ("", mixed, 1)
    assert bus("bag", "play", "-i", bag, "-i", "nowhere") == ("", "Bag path 'nowhere' does not exist!\n", 1)
    wrong = bus("bag", "play", "-i", bag, "rosbag")
    assert wrong == ("", "Unknown storage ID 'rosbag', options are: mcap, sqlite3\n", 1)
    for verb in ("play", "burst"):
        missing = bus("bag", verb)
        assert missing.err.endswith(
            f"bus bag {verb}: error: give the bag to play, or -i BAG for each of several bags\n"
        )
        assert missing.code == 2


def test_convert(tmp_path: Path) -> None:
    messages = said(10)
    first, second = write_bag(tmp_path / "a", messages[:5]), write_bag(tmp_path / "b", messages[5:])
    options = tmp_path / "out.yaml"
    options.write_text(f"output_bags: [{{uri: {tmp_path}/c, storage_preset_profile: zstd_fast}}]")
    words = ("-i", str(first), "-i", str(second), "mcap", "-o", str(options))
    assert bus("bag", "convert", *words) == (f"{tmp_path}/c\n", "", 0)
    with open_bag(tmp_path / "c") as reader:
        assert read(reader) == messages
    assert bus("bag", "convert", *words) == ("", f"Output folder '{tmp_path}/c' already exists.\n", 1)
    options.write_text("output_bags: {}")
    assert bus("bag", "convert", *words) == ("", f"'{options}': it has no list 'output_bags'\n", 1)
    assert bus("bag", "convert", "-i", "nowhere", "-o", "x") == (
        "",
        "Bag path 'nowhere' does not exist!\n",
        1,
    )
    wrong = bus("bag", "convert", "-i", str(first), "rosbag", "-o", "x")
    assert wrong == ("", "Unknown storage ID 'rosbag', options are: mcap, sqlite3\n", 1)
