"""Runs the attack in its argument until the parent closes stdin."""

import os
import sys
from collections.abc import Callable

from benchmarks.adapters.hostile import coming, crowding, frames, load
from benchmarks.adapters.hostile.attack import Attack, Kind
from benchmarks.adapters.hostile.tally import Tally
from benchmarks.worker import options

_CUT_OFF = (ConnectionError, TimeoutError)
_REST_S = 0.05
"""Pause of a refused client before it connects again: a storm of connections is another attack."""

FLOODS: dict[Kind, Callable[[Attack, Tally], None]] = {
    "busy loop": load.busy_loop,
    "socket": load.two_by_socket,
    "shared memory": load.shared_memory,
    "runs": frames.runs,
    "acks": frames.acks,
    "reports": frames.reports,
    "signs of life": frames.signs_of_life,
    "attaches": frames.attaches,
    "pings": frames.pings,
    "questions": frames.questions,
    "observers": frames.observers,
    "endpoints": coming.endpoints,
    "types": coming.types,
    "matches": coming.matches,
    "incompatible": coming.incompatible,
    "connections": coming.connections,
    "garbage": coming.garbage,
    "flapping": crowding.flapping,
    "replays": crowding.replays,
    "rings": crowding.rings,
    "slow reader": crowding.slow_reader,
    "everything": crowding.everything,
}


def main() -> None:
    attack: Attack = options(Attack)
    if attack.uid:
        os.setgroups(())
        os.setgid(attack.uid)
        os.setuid(attack.uid)
    tally = Tally()
    while True:
        try:
            FLOODS[attack.kind](attack, tally)
            return
        except _CUT_OFF as error:
            print(error, file=sys.stderr)
            if not tally.add(0, 1, wait_s=_REST_S):
                return


if __name__ == "__main__":
    main()
