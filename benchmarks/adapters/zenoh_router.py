"""A router of zenoh, as zenohd is one: it only passes on. Its argument is the endpoint."""

import asyncio
import json
import sys

import zenoh

from benchmarks.worker import Parent, run


async def main(parent: Parent) -> None:
    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": "router",
        "scouting/multicast/enabled": False,
        "listen/endpoints": [sys.argv[1]],
    }
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    with zenoh.open(config):
        parent.tell("ready")
        await asyncio.Event().wait()


if __name__ == "__main__":
    run(main)
