"""The options of `bus bag record` for compression, as ROS 2 has them.

ROS 2 compresses whole files or single messages. busd compresses the chunks of an MCAP file instead, so
readers can seek in it.
"""

from argparse import ArgumentParser, Namespace

from bus_cli.output import CommandError, complain

__all__ = ["add_compression_arguments", "preset_of"]

_PRESET = "zstd_fast"
_WITHOUT_CHUNKS = "fastwrite"


def add_compression_arguments(parser: ArgumentParser) -> None:
    group = parser.add_argument_group("compression")
    group.add_argument(
        "--compression-mode",
        choices=("none", "file", "message"),
        default="none",
        help=f"file, message: compress chunks of messages, as --storage-preset-profile {_PRESET}",
    )
    group.add_argument("--compression-format", choices=("zstd",), default="", help="the compression format")
    group.add_argument(
        "--compression-queue-size",
        type=int,
        default=1,
        metavar="N",
        help="ignored: --max-cache-size bounds the waiting messages",
    )
    for name in ("--compression-threads", "--compression-threads-priority"):
        group.add_argument(
            name, type=int, default=0, metavar="N", help="ignored: the thread that writes compresses"
        )


def preset_of(args: Namespace) -> str:
    """The storage preset for the options. Raises CommandError if they contradict each other."""
    preset: str = args.storage_preset_profile
    if args.compression_queue_size < 0:
        raise _error("Compression queue size must be at least 0.")
    if args.compression_mode == "none":
        if args.compression_format:
            raise _error("Invalid choice: Cannot specify compression format without a compression mode.")
        return preset
    if preset == _WITHOUT_CHUNKS:
        raise _error(f"--compression-mode compresses chunks, and a file of {_WITHOUT_CHUNKS} has none")
    chosen = _PRESET if preset == "none" else preset
    complain(
        f"[WARN] [ros2bag]: --compression-mode {args.compression_mode}: chunks of messages are compressed "
        f"instead, as with --storage-preset-profile {chosen}"
    )
    return chosen


def _error(text: str) -> CommandError:
    return CommandError(f"[ERROR] [ros2bag]: {text}")
