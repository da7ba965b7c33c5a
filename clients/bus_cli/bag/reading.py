"""Shared code of the verbs that read a bag."""

from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from bus_cli.output import CommandError, complain

if TYPE_CHECKING:
    from bus.qos import QoSProfile
    from bus_bag.storage import BagReader

__all__ = [
    "add_bag_argument",
    "add_input_argument",
    "add_storage_argument",
    "input_paths",
    "opened",
    "overrides_in",
    "print_problems",
]

_MOST = 20
"""Number of problems printed one by one."""


def add_bag_argument(parser: ArgumentParser) -> None:
    """Add `bag_path` and `-s`."""
    parser.add_argument("bag_path", type=Path, help="Bag to open.")
    add_storage_argument(parser)


def add_storage_argument(parser: ArgumentParser) -> None:
    """Add `-s`."""
    from bus_bag.storage.registry import storages

    parser.add_argument(
        "-s",
        "--storage",
        default="",
        choices=[one.identifier for one in storages()],
        help="Storage implementation of bag; ignored, because files identify themselves",
    )


def add_input_argument(parser: ArgumentParser, *, is_required: bool) -> None:
    """Add `-i`, for several bags."""
    parser.add_argument(
        "-i",
        "--input",
        required=is_required,
        action="append",
        nargs="+",
        default=[],
        metavar=("uri", "storage_id"),
        help="URI (and optional storage ID) of an input bag. May be provided more than once",
    )


def input_paths(args: Namespace) -> list[Path]:
    """The bags of all `-i`. Errors have ROS 2's texts."""
    return [_input_path(words) for words in args.input]


def _input_path(words: list[str]) -> Path:
    from bus_bag.storage.registry import storages

    if len(words) > 2:
        raise CommandError(f"--input expects 1 or 2 arguments, {len(words)} provided")
    path = Path(words[0])
    if not path.exists():
        raise CommandError(f"Bag path '{path}' does not exist!")
    known = [one.identifier for one in storages()]
    if len(words) == 2 and words[1] not in known:
        raise CommandError(f"Unknown storage ID '{words[1]}', options are: {', '.join(known)}")
    return path


@contextmanager
def opened(args: Namespace) -> "Iterator[BagReader]":
    """Open the bag; at the end, print the problems met while reading."""
    from bus_bag.storage import open_bag

    with open_bag(args.bag_path) as reader:
        try:
            yield reader
        finally:
            print_problems(reader)


def print_problems(reader: "BagReader") -> None:
    """Print one line for each problem on stderr, and advice."""
    problems = reader.problems
    for problem in problems[:_MOST]:
        complain(f"[WARN] [ros2bag]: {problem}")
    if len(problems) > _MOST:
        complain(f"[WARN] [ros2bag]: and {len(problems) - _MOST} more of this kind")
    is_whole = not reader.is_cut and (reader.path / "metadata.yaml").exists()
    if problems and reader.path.is_dir() and not is_whole and not reader.is_being_written:
        complain(f"[WARN] [ros2bag]: to repair it: bus bag reindex {reader.path}")


def overrides_in(path: str | None) -> "dict[str, QoSProfile]":
    """Profiles by topic, read from a `--qos-profile-overrides-path` file; empty without a file."""
    if path is None:
        return {}
    from bus.errors import ConfigurationError
    from bus_bag.profiles import overrides_from_yaml
    from bus_bag.yaml_text import load

    try:
        return overrides_from_yaml(load(Path(path).read_text(errors="replace")))
    except ConfigurationError as error:
        raise CommandError(f"[ERROR] [ros2bag]: {error}") from None
    except ValueError as error:
        raise CommandError(f"[ERROR] [ros2bag]: '{path}' can't be used: {error}") from None
