"""A process that only asks busd whether it is there: how long busd leaves it without an answer.

Pings by a client of its own, one after the other. Says `ready` when the first was answered, and on the word
`report` `pinged` with `longest_ms`, the longest that one took to be answered since then.
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
