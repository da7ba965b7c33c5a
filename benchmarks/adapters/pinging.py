"""A process that only pings busd: measures the longest time without an answer of busd.

It pings by a separate client, one ping after the other. It says `ready` after the first answer. On the word
`report` it says `pinged` with `longest_ms`, the longest time until an answer since then.
"""

import sys
from select import poll
from time import monotonic_ns, sleep

from benchmarks.adapters.hostile.raw import Client
from benchmarks.worker import tell

_PERIOD_S = 0.005


def main() -> None:
    words = poll()
    words.register(0)
    with Client() as client:
        client.barrier()
        tell("ready")
        longest_ns = 0
        while True:
            begin_ns = monotonic_ns()
            client.barrier()
            longest_ns = max(longest_ns, monotonic_ns() - begin_ns)
            if words.poll(0):
                if not sys.stdin.readline():
                    return
                tell("pinged", longest_ms=longest_ns / 1e6)
                longest_ns = 0
            sleep(_PERIOD_S)


if __name__ == "__main__":
    main()
