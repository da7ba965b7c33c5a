"""A router of zenoh at the address that is its argument, until a signal ends it."""

import json
import signal
import sys

import zenoh


def main() -> None:
    config = zenoh.Config()
    settings = {
        "mode": "router",
        "scouting/multicast/enabled": False,
        "listen/endpoints": sys.argv[1:],
    }
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    ends = {signal.SIGTERM, signal.SIGINT}
    signal.pthread_sigmask(signal.SIG_BLOCK, ends)
    with zenoh.open(config):
        signal.sigwait(ends)


if __name__ == "__main__":
    main()
