"""A signal at any moment of a start ends the program: always, by that signal, and without a traceback.

Each case prints its ends (`pytest --nightly -s -n0`). BUSD_EARLY_STARTS is the number of starts with SIGINT;
a fifth as many get SIGTERM. BUSD_EARLY_SEED repeats the moments of a run; each run prints its seed.
"""

import os
import signal
from pathlib import Path
from random import Random, SystemRandom

import pytest

from earlysignals import LOST_BY_PYTHON, programs, try_out

NAMES = ("talker.py", "listener.py", "bus.connect", "bus run", "bus topic echo", "busd")
STARTS = int(os.environ.get("BUSD_EARLY_STARTS", "1000"))
SEED = int(os.environ.get("BUSD_EARLY_SEED", SystemRandom().randrange(1 << 32)))


@pytest.mark.nightly
@pytest.mark.timeout(3600)
@pytest.mark.usefixtures("daemon")
@pytest.mark.parametrize(("number", "share"), [(signal.SIGINT, 1), (signal.SIGTERM, 5)], ids=["INT", "TERM"])
@pytest.mark.parametrize("name", NAMES)
def test_a_signal_at_a_random_moment(tmp_path: Path, name: str, number: signal.Signals, share: int) -> None:
    starts = -(-STARTS // len(NAMES) // share)
    found = try_out(programs(tmp_path)[name], starts, number, Random(SEED), tmp_path)
    print(f"{name}, {number.name}, seed {SEED}: {found}")
    assert not found.bad, "\n".join(found.bad)
    assert found.ends[LOST_BY_PYTHON] <= starts // 100
