"""The options of `bus bag record` for compression."""

from argparse import ArgumentParser

import pytest

from bus_cli.bag.compression import preset_of
from bus_cli.bag.record import add_arguments
from bus_cli.output import CommandError


def chosen(*words: str) -> str:
    parser = ArgumentParser()
    add_arguments(parser)
    return preset_of(parser.parse_args(["-a", *words]))


@pytest.mark.parametrize(
    ("words", "preset"),
    [
        ((), "none"),
        (("--compression-threads", "4", "--compression-threads-priority", "-5"), "none"),
        (("--compression-mode", "file"), "zstd_fast"),
        (("--compression-mode", "message", "--compression-format", "zstd"), "zstd_fast"),
        (("--compression-mode", "file", "--storage-preset-profile", "zstd_small"), "zstd_small"),
        (("--storage-preset-profile", "fastwrite"), "fastwrite"),
    ],
)
def test_the_preset(words: tuple[str, ...], preset: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert chosen(*words) == preset
    is_other = "--compression-mode" in words
    assert ("chunks of messages are compressed instead" in capsys.readouterr().err) is is_other


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--compression-format", "zstd"), "Cannot specify compression format without a compression mode"),
        (("--compression-queue-size", "-1"), "Compression queue size must be at least 0"),
        (
            ("--compression-mode", "file", "--storage-preset-profile", "fastwrite"),
            "--compression-mode compresses chunks, and a file of fastwrite has none",
        ),
    ],
)
def test_options_that_contradict(words: tuple[str, ...], text: str) -> None:
    with pytest.raises(CommandError, match=text):
        chosen(*words)
