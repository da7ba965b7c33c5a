"""`bus bag list`: the formats of files, of messages and of compression."""

from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from typing import NamedTuple

from bus_cli.output import print_json, say

_KINDS = ("storage", "converter", "compressor", "decompressor")


class _Plugin(NamedTuple):
    name: str
    description: str
    type: str
    base_class: str


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("plugin_type", help="lists available plugins", choices=_KINDS)
    parser.add_argument(
        "-v", "--verbose", action="store_true", help="output verbose information about the available plugin"
    )


def main(args: Namespace) -> int:
    if args.verbose and not args.json:
        say(f"available {args.plugin_type} plugins are:")
    for plugin in _plugins(args.plugin_type):
        if args.json:
            print_json(plugin._asdict())
        elif args.verbose:
            say(f"name: {plugin.name}\n\t{plugin.description}")
            say(f"\ttype: {plugin.type}\n\tbase_class: {plugin.base_class}")
        else:
            say(plugin.name)
    return 0


def _plugins(kind: str) -> Iterator[_Plugin]:
    if kind == "storage":
        yield from _storages()
    elif kind == "converter":
        text = "CDR, the format of messages in bags, to and from busd's"
        yield _Plugin("cdr_converter", text, "bus_ros.cdr", "bus_ros.cdr.Codec")
    elif kind == "compressor":
        text = "Zstandard, for the chunks of a file (--storage-preset-profile)"
        yield _Plugin("zstd", text, "bus_bag.storage.mcap_writer", "bus_bag.storage.registry.WritableStorage")
    else:
        text = "Zstandard, for chunks, whole files and single messages"
        yield _Plugin("zstd", text, "bus_bag.storage.decompression", "bus_bag.storage.registry.Storage")


def _storages() -> Iterator[_Plugin]:
    from bus_bag.storage.registry import Storage, WritableStorage, storages

    for storage in storages():
        is_writable = isinstance(storage, WritableStorage)
        base = WritableStorage if is_writable else Storage
        text = f"files {storage.suffix}, {'read and written' if is_writable else 'read only'}"
        yield _Plugin(storage.identifier, text, _name(type(storage)), _name(base))


def _name(cls: type) -> str:
    return f"{cls.__module__}.{cls.__qualname__}"
